//! Measures segments for their page: what they cost over time, and their error over time and over layers.

use std::path::Path;

use anyhow::bail;
use codec::{Camera, Segment, SegmentLayer, Surroundings, SurroundingsBuilder, Take};
use measure::measured_cameras;
use measure::parameter::{ParameterValue, Quartiles};
use program::Fault;
use refine::fit::Cpu;
use refine::image::{Image, psnr};
use refine::reference::{Order, Radius, RenderScene, coverage, render, render_with_subject};

use crate::commands::capture::PartSelection;
use crate::commands::fit_source::FitSource;
use crate::eval::{Photographs, over_time};
use crate::input::{Input, check_one_field};
use crate::left_out::{LeftOut, TakeLeftOut};
use crate::machine::machine;
use crate::messages::decimal;
use crate::package::{PackageSettings, SegmentSources, package_take};
use crate::progress::StagedProgress;
use crate::report::{LayerInstant, TakeFindings, TakeInstant, TakePhotographs, TakeSetup, layers_parameter};
use crate::scene::name_of;
use crate::segments::{FieldFolder, Span, TakeFile, TakeWalk, course, gaps};

/// Default size of the measured pictures.
const SIZE: [u32; 2] = [320, 240];

/// Equal parts of a take at whose ends it is measured.
const PARTS: usize = 40;

/// Most cuts at which it is measured.
const CUTS: usize = 20;

/// Seconds before a cut at which a picture shows the take before it.
const BEFORE_S: f64 = 1e-4;

/// Instants at which layers are compared.
const LAYER_INSTANTS: usize = 16;

/// Most cameras that a take is measured from, and whose photographs it is compared with.
const CAMERAS: usize = 3;

/// Largest difference of the durations of a take and its field in seconds: rounding.
const DURATION_SLACK_S: f64 = 1e-3;

/// What a page is made of.
pub(super) struct TakeRequest<'a> {
    /// A take, or a field folder, which is packaged first and is then the reference.
    pub(super) path: &'a Path,
    /// The field folder or field that the take was packaged from.
    pub(super) reference: Option<&'a Path>,
    /// Size of the measured pictures.
    pub(super) size: Option<[u32; 2]>,
    /// Folder of its capture, and the cameras and frames of it.
    pub(super) capture: Option<&'a Path>,
    pub(super) part: &'a PartSelection,
}

/// Measures a take or a field folder.
pub(super) fn measure(request: &TakeRequest) -> anyhow::Result<TakeFindings> {
    let TakeRequest { path, reference, .. } = *request;
    if !FieldFolder::is_one(path) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        return measure_file(path, &name, reference, request);
    }
    if let Some(reference) = reference {
        let what = "a field folder is compared with itself; leave it out, or name a package of the folder";
        bail!(Fault::Usage(format!("{}: {what}", reference.display())));
    }
    let folder = tempfile::tempdir()?;
    let packaged = folder.path().join("take.aarc");
    package_take(
        &SegmentSources::of_folder(path)?,
        &PackageSettings::default(),
        &mut Cpu::default(),
        None,
        &packaged,
    )?;
    measure_file(&packaged, &name_of(path), Some(path), request)
}

/// The field that a take is compared with.
enum Reference {
    Folder(TakeWalk<'static>),
    Whole(Box<Input>),
}

impl Reference {
    /// # Errors
    /// [`Fault::Usage`] if it lasts longer or shorter than the take.
    fn load(path: &Path, take: &Take) -> anyhow::Result<Reference> {
        let (reference, duration_s) = if FieldFolder::is_one(path) {
            let walk = TakeWalk::of_folder(path)?;
            let duration_s = walk.duration_s();
            (Reference::Folder(walk), duration_s)
        } else {
            check_one_field(path)?;
            let input = Input::load(path)?;
            let duration_s = f64::from(input.info().duration_s);
            (Reference::Whole(Box::new(input)), duration_s)
        };
        check_duration(path, duration_s, take, "name the field that the take was packaged from")?;
        Ok(reference)
    }

    fn at(&mut self, t_s: f64) -> anyhow::Result<RenderScene<'_>> {
        match self {
            Reference::Folder(walk) => {
                walk.go_to(t_s)?;
                Ok(walk.to_reference(None))
            }
            Reference::Whole(input) => Ok(input.to_reference()),
        }
    }
}

fn measure_file(
    path: &Path,
    name: &str,
    reference: Option<&Path>,
    request: &TakeRequest,
) -> anyhow::Result<TakeFindings> {
    let size = request.size.unwrap_or(SIZE);
    let file = open_whole(path)?;
    let take = file.take();
    let mut compared = reference.map(|path| Reference::load(path, take)).transpose()?;
    let compared_with = request.capture.map(|folder| photographs_of(folder, request, take)).transpose()?;
    let surroundings = surroundings(&file)?;
    let cameras = measured_cameras(&take.info, &surroundings, CAMERAS, size);
    let layers = file.layers().len();
    let (cuts, times) = (cuts(take), instants(take));
    let progress = StagedProgress::visible();

    let mut walk = TakeWalk::of_file(&file);
    progress.stage("over time", times.len());
    let mut instants = Vec::new();
    for &time in &times {
        instants.push(instant(&mut walk, compared.as_mut(), &cameras, time)?);
        progress.step();
    }
    let of_layers = LayerErrors::measure(layers, &mut walk, &cameras, &progress)?;
    let photographs = match &compared_with {
        Some(compared_with) => Some(photographs(compared_with, &mut walk, &cuts, &progress)?),
        None => None,
    };
    progress.stage("segments", take.segments.len());
    let left_out = left_out(&file, || progress.step())?;
    progress.finish();
    let spans: Vec<Span> = take.segments.iter().map(Span::from).collect();
    Ok(TakeFindings {
        name: name.to_owned(),
        machine: machine(),
        setup: TakeSetup {
            segments: take.segments.len(),
            gaussians: take.segments.iter().map(Segment::gaussians).sum(),
            bytes: take.package_bytes(),
            duration_s: take.duration_s,
            layers,
            size,
            viewpoint: surroundings.first_viewpoint(&take.info).name,
            cameras: cameras.len(),
            reference: reference.map(name_of),
        },
        course: course(take),
        cuts,
        gaps: gaps(take.duration_s, &spans),
        instants,
        parameter: (layers > 1).then(|| layers_parameter(of_layers.points(&file))),
        layers: of_layers.instants,
        photographs,
        left_out,
    })
}

/// Checks that what is at `path` lasts as long as a take; `advice` says what to do otherwise.
fn check_duration(path: &Path, duration_s: f64, take: &Take, advice: &str) -> Result<(), Fault> {
    if (duration_s - take.duration_s).abs() <= DURATION_SLACK_S {
        return Ok(());
    }
    let [own, of_take] = [duration_s, take.duration_s].map(|seconds| decimal(seconds, 3));
    Err(Fault::Usage(format!("{}: it lasts {own} s, and the take {of_take} s; {advice}", path.display())))
}

/// Opens the file of a take that is all there.
fn open_whole(path: &Path) -> anyhow::Result<TakeFile> {
    let file = TakeFile::open(path)?;
    let (bytes, all) = (file.bytes(), file.take().package_bytes());
    if bytes < all {
        bail!(Fault::Data(format!(
            "{}: cut short, {bytes} of {all} bytes; get the file again",
            path.display()
        )));
    }
    Ok(file)
}

/// Opens the capture that a take was fitted to, with the cameras and mattes of the fit.
///
/// # Errors
/// [`Fault::Usage`] if it lasts longer or shorter than the take.
fn photographs_of(folder: &Path, request: &TakeRequest, take: &Take) -> anyhow::Result<Photographs> {
    let mut capture_files = request.part.open(folder, None)?;
    let duration_s = capture_files.capture.duration_s();
    check_duration(folder, duration_s, take, "name its capture, and its frames with --frames")?;
    let source = FitSource::new(request.path, &Input::load_at(request.path, &[0.0])?);
    let (holdout, _) = source.held_frames(None);
    source.prepare(&mut capture_files, holdout)?;
    if source.has_plate {
        capture_files.keep_background();
    }
    Ok(Photographs::new(&capture_files, source.has_plate))
}

/// Compares a take with the photographs of a few cameras, spread evenly.
fn photographs(
    compared_with: &Photographs,
    walk: &mut TakeWalk,
    cuts_s: &[f64],
    progress: &StagedProgress,
) -> anyhow::Result<TakePhotographs> {
    let capture = compared_with.capture();
    let all = capture.cameras.len();
    let count = all.min(CAMERAS);
    let cameras: Vec<usize> = (0..count).map(|i| (2 * i + 1) * all / (2 * count)).collect();
    progress.stage("photographs", capture.frames());
    let draw = |camera: &Camera, t_s: f64| {
        walk.go_to(t_s)?;
        Ok(render_with_subject(&walk.to_reference(None), camera, t_s / walk.duration_s(), Order::Depth))
    };
    let frames = over_time(compared_with, &cameras, draw, || progress.step())?;
    let cameras = cameras.into_iter().map(|camera| capture.cameras[camera].name.clone()).collect();
    Ok(TakePhotographs::new(cameras, frames, cuts_s))
}

/// Seconds at which a segment begins or ends, ascending, without the ends of the take.
fn cuts(take: &Take) -> Vec<f64> {
    let ends = take.segments.iter().flat_map(|segment| [segment.start_s, segment.end_s()]);
    let mut cuts: Vec<f64> =
        ends.filter(|t_s| (BEFORE_S..take.duration_s - BEFORE_S).contains(t_s)).collect();
    cuts.sort_by(f64::total_cmp);
    // Sums of seconds are rounded.
    cuts.dedup_by(|a, b| (*a - *b).abs() < BEFORE_S);
    cuts
}

/// The seconds at which a take is measured, ascending, with whether they are at a cut.
fn instants(take: &Take) -> Vec<(f64, bool)> {
    let cuts = cuts(take);
    let chosen = cuts.len().min(CUTS);
    let cut = |i: usize| cuts[i * cuts.len() / chosen];
    let mut instants: Vec<(f64, bool)> =
        (0..chosen).flat_map(|i| [cut(i) - BEFORE_S, cut(i)]).map(|t_s| (t_s, true)).collect();
    let even = (0..=PARTS).map(|i| i as f64 / PARTS as f64 * take.duration_s);
    instants.extend(even.map(|t_s| (t_s, false)));
    instants.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Evenly spread instants may be at cuts.
    instants.dedup_by(|b, a| {
        let is_same = (b.0 - a.0).abs() < 0.5 * BEFORE_S;
        a.1 |= is_same && b.1;
        is_same
    });
    instants
}

/// Where people stand, over all of the time. Decodes one segment after another.
///
/// # Errors
/// Those of [`TakeFile::decode`].
fn surroundings(file: &TakeFile) -> Result<Surroundings, Fault> {
    let take = file.take();
    let mut builder = SurroundingsBuilder::new(take.segments.iter().map(Segment::gaussians).sum());
    for index in 0..take.segments.len() {
        let clip = file.decode(index)?;
        for field in [&clip.static_field, &clip.dynamic_field] {
            builder.add(field, [0.0, 1.0]);
        }
        clip.plate.iter().for_each(|plate| builder.add_plate(plate));
    }
    Ok(builder.build(take.info.up))
}

/// Goes to an instant and measures it.
fn instant(
    walk: &mut TakeWalk,
    reference: Option<&mut Reference>,
    cameras: &[Camera],
    (t_s, is_cut): (f64, bool),
) -> anyhow::Result<TakeInstant> {
    walk.go_to(t_s)?;
    let (scene, t) = (walk.to_reference(None), t_s / walk.duration_s());
    let counts = coverage(&scene, cameras, t, Radius::Exact);
    let psnr_db = match reference {
        None => None,
        Some(reference) => {
            let expected = reference.at(t_s)?;
            let errors = cameras.iter().map(|camera| {
                let [picture, expected] = [&scene, &expected].map(|s| render(s, camera, t, Order::Depth));
                picture.squared_error(&expected)
            });
            finite(psnr(errors.sum(), pixels(cameras)))
        }
    };
    Ok(TakeInstant {
        t_s,
        is_cut,
        segments: walk.segments(),
        resident: walk.gaussians(),
        alive: counts.alive,
        fragments_per_pixel: counts.fragments as f64 / pixels(cameras) as f64,
        psnr_db,
    })
}

fn pixels(cameras: &[Camera]) -> usize {
    cameras.iter().map(|camera| camera.width as usize * camera.height as usize).sum()
}

/// `None` where pictures are the same.
fn finite(psnr_db: f64) -> Option<f64> {
    Some(psnr_db).filter(|db| db.is_finite())
}

/// Errors and fragments of the first layers, over instants.
struct LayerErrors {
    instants: Vec<LayerInstant>,
    /// Pictures of all instants, and their pixels.
    pictures: usize,
    pixels: usize,
    /// By number of layers: squared errors of all pictures, and their fragments.
    squared_errors: Vec<f64>,
    fragments: Vec<u64>,
}

impl LayerErrors {
    fn new(layers: usize) -> LayerErrors {
        LayerErrors {
            instants: Vec::new(),
            pictures: 0,
            pixels: 0,
            squared_errors: vec![0.0; layers],
            fragments: vec![0; layers],
        }
    }

    /// Goes to several instants and compares the first layers with all; to none where there is one layer.
    fn measure(
        layers: usize,
        walk: &mut TakeWalk,
        cameras: &[Camera],
        progress: &StagedProgress,
    ) -> anyhow::Result<LayerErrors> {
        let mut errors = LayerErrors::new(layers);
        let count = if layers > 1 { LAYER_INSTANTS } else { 0 };
        progress.stage("layers", count);
        for i in 0..count {
            let t_s = (i as f64 + 0.5) / count as f64 * walk.duration_s();
            walk.go_to(t_s)?;
            errors.add(walk, cameras, t_s);
            progress.step();
        }
        Ok(errors)
    }

    /// Adds the pictures of an instant that the walk has gone to.
    fn add(&mut self, walk: &TakeWalk, cameras: &[Camera], t_s: f64) {
        let t = t_s / walk.duration_s();
        let layers = self.fragments.len();
        let mut pictures = |k: usize| -> Vec<Image> {
            let scene = walk.to_reference(Some(k));
            self.fragments[k - 1] += coverage(&scene, cameras, t, Radius::Exact).fragments;
            cameras.iter().map(|camera| render(&scene, camera, t, Order::Depth)).collect()
        };
        let whole = pictures(layers);
        let mut psnr_db = Vec::new();
        for k in 1..layers {
            let part = pictures(k);
            let squared_error = part.iter().zip(&whole).map(|(part, whole)| part.squared_error(whole)).sum();
            self.squared_errors[k - 1] += squared_error;
            psnr_db.push(finite(psnr(squared_error, pixels(cameras))));
        }
        self.pictures += cameras.len();
        self.pixels += pixels(cameras);
        self.instants.push(LayerInstant { t_s, psnr_db });
    }

    /// The values of the parameter: 1 layer to all.
    fn points(&self, file: &TakeFile) -> Vec<ParameterValue> {
        let layers = file.layers();
        let point = |k: usize| {
            let SegmentLayer { bytes, gaussians } = layers[k - 1];
            let error = psnr(self.squared_errors[k - 1], self.pixels);
            let counts = [
                ("package_bytes", bytes as f64),
                ("gaussians_decoded", gaussians as f64),
                ("covered_fragments", self.fragments[k - 1] as f64 / self.pictures as f64),
            ];
            let is_all = k == layers.len();
            let value = if is_all { format!("{k}, all") } else { k.to_string() };
            let mbps = Quartiles::exactly(bytes as f64 * 8e-6 / file.take().duration_s);
            ParameterValue::new(&value, is_all, mbps, error, &counts)
        };
        (1..=layers.len()).map(point).collect()
    }
}

/// What segments lack; calls `on_segment` after each.
fn left_out(file: &TakeFile, on_segment: impl Fn()) -> anyhow::Result<Vec<LeftOut>> {
    let take = file.take();
    let mut sums = TakeLeftOut::of_table(take);
    for index in 0..take.segments.len() {
        sums.add(take, &file.contents(index)?, &file.decode(index)?);
        on_segment();
    }
    Ok(sums.parts)
}
