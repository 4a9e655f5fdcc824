//! [`Bench`]: makes and measures the parts of an ablation that the folder of the report lacks.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use program::{Fault, output};
use refine::capture::{Holdout, PhotoId, Split};
use refine::fit::Cpu;
use refine::fit::Lpips;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::capture::{CameraCorrections, CaptureFiles};
use crate::commands::capture::load_training_views;
use crate::commands::eval::write_picture;
use crate::commands::fit::{FitOptions, FitResult, fit_and_write};
use crate::commands::fit_plate::fit_plate;
use crate::eval::{
    self, Crop, Photographs, SplitMeasures, Subject, fragments_per_lit_pixel, judge, parse_csv,
};
use crate::fit::{self, FitPlan, PlatePlan, TrainingViews, log};
use crate::messages::unreadable;
use crate::package::{PackageSettings, package_with};
use crate::progress::{StagedProgress, counting};
use crate::report::ablation::{
    Ablation, FieldFigures, LeftOut, Method, PackageFigures, Picture, PicturedView, VARIANTS, Variant,
};
use crate::scene::{Scene, cameras_path, learned_cameras_of, plate_path};
use crate::takes::{OutputState, Record, key};

/// Name of the field in the folder of a fit.
const FIELD: &str = "field.ply";

/// Commands in the records; the command of `eval` counts the changes of its columns and measures.
const FIT: &str = "report: fit";
pub(super) const EVAL: &str = "report: eval 4";
const PACKAGE: &str = "report: package";

/// Held frames: every table of the paper holds every other one.
pub(super) const HOLDOUT: Holdout = Holdout::Odd;

/// Splits that the page shows pictures of, and the number of photographs of each.
const PICTURED: [Split; 3] = [Split::InterpA, Split::InterpB, Split::Recon];
const PICTURED_OF_SPLIT: usize = 2;

/// Whether an error is of the data.
pub(super) fn is_of_data(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref(), Some(Fault::Data(_)))
}

/// A held photograph that the page shows.
pub(super) struct PicturedPhoto {
    photo_id: PhotoId,
    split: Split,
    /// Name of the PNGs of it.
    file: String,
    crop: Crop,
}

/// Selects the photographs that the page shows, evenly from the held splits.
pub(super) fn pictured(capture_files: &CaptureFiles) -> Result<Vec<PicturedPhoto>, Fault> {
    let splits = eval::splits(capture_files, HOLDOUT)?;
    let mut pictured = Vec::new();
    for split in PICTURED {
        let photos: Vec<PhotoId> =
            splits.iter().filter(|(_, photos)| *photos == split).map(|(photo_id, _)| *photo_id).collect();
        let count = photos.len().min(PICTURED_OF_SPLIT);
        for i in 0..count {
            let photo_id = photos[(2 * i + 1) * photos.len() / (2 * count)];
            let name = capture_files.name(photo_id).replace(['/', '\\', ' '], "_");
            let crop = Crop::around(&[&capture_files.photo(photo_id)?]);
            pictured.push(PicturedPhoto {
                photo_id,
                split,
                file: format!("{}-{name}.png", split.name()),
                crop,
            });
        }
    }
    Ok(pictured)
}

/// The photographs that a fit's pictures are compared with. Where there are plates, fits show the whole picture.
fn judged_files(capture_files: &CaptureFiles) -> CaptureFiles {
    let mut judged_files = capture_files.clone();
    if judged_files.has_plates() {
        judged_files.keep_background();
    }
    judged_files
}

/// What the measurements share.
pub(super) struct Bench<'a> {
    /// The folder of the report.
    pub(super) out: &'a Path,
    pub(super) options: &'a FitOptions,
    pub(super) capture_files: CaptureFiles,
    /// Hash of the photographs, and of the part that is read.
    pub(super) photographs_key: String,
    pub(super) lpips: Option<Lpips<f32>>,
    /// The photographs that the page shows.
    pub(super) pictured: Vec<PicturedPhoto>,
    /// The decoded photographs of the last fit, and what became of their background.
    pub(super) views: Option<(PlatePlan, TrainingViews)>,
    pub(super) ablation: Ablation,
}

/// Measures of a subject.
struct JudgedSubject {
    splits: Vec<SplitMeasures>,
    fragments_per_lit_pixel: Option<f64>,
}

/// What a record of [`PACKAGE`] holds, under the keys of the JSON of `package`.
#[derive(Deserialize)]
struct PackageRecord {
    gaussians_out: usize,
    bytes: usize,
    duration_s: f64,
    topology: TopologyRecord,
}

#[derive(Deserialize)]
struct TopologyRecord {
    recall: f64,
}

impl Bench<'_> {
    /// Lists a row that the tables lack.
    pub(super) fn leave_out(&mut self, name: &str, why: &str) {
        self.ablation.left_out.push(LeftOut { name: name.into(), why: why.into() });
    }

    fn images(&self) -> usize {
        self.capture_files.capture.photos.len()
    }

    /// Path of a file, within the folder of the report.
    fn path(&self, folder: &str, file: &str) -> PathBuf {
        self.out.join(folder).join(file)
    }

    /// Writes the held photographs that the page shows.
    pub(super) fn photographs(&mut self) -> anyhow::Result<()> {
        output::make_folder(&self.out.join("photographs"))?;
        let judged_files = judged_files(&self.capture_files);
        for photo in &self.pictured {
            let image = photo.crop.apply(&judged_files.photo(photo.photo_id)?.image);
            write_picture(&self.path("photographs", &photo.file), &image)?;
            let name = format!("{}, {}", self.capture_files.name(photo.photo_id), photo.split.name());
            self.ablation.views.push(PicturedView { name, pictures: Vec::new() });
        }
        self.show("photograph", "photographs")
    }

    /// Shows the pictures of a folder beside the photographs.
    fn show(&mut self, method: &str, folder: &str) -> anyhow::Result<()> {
        for (i, photo) in self.pictured.iter().enumerate() {
            let path = self.path(folder, &photo.file);
            // A folder of pictures may lack some.
            if path.is_file() {
                let png = fs::read(&path).map_err(|error| unreadable(&path, &error))?;
                self.ablation.views[i].pictures.push(Picture { method: method.into(), png });
            }
        }
        Ok(())
    }

    /// Fits, measures and packages a variant. A field that equals an earlier variant's field has its packages, too.
    pub(super) fn variant(
        &mut self,
        variant: &Variant,
        plan: &FitPlan,
        budgets: &[usize],
    ) -> anyhow::Result<()> {
        let folder = variant.folder();
        output::make_folder(&self.out.join(&folder))?;
        let field = self.path(&folder, FIELD);
        let report = self.fit(plan, &field)?;
        let subject = Subject::load(&field, &self.capture_files)?;
        let judged =
            self.judge(&subject, &field, Some(cameras_path(&field)), variant.name, &folder, "eval")?;
        let table = log::table_path(&field);
        let entries = fs::read_to_string(&table).map_err(|error| unreadable(&table, &error))?;
        let mut about = variant.about.to_owned();
        let twin = self.twin(variant, &field)?;
        if let Some(twin) = twin {
            about += &format!("; the field is that of {twin}, so the difference had no effect");
        }
        self.ablation.methods.push(Method {
            name: variant.name.into(),
            about,
            fit: Some(FieldFigures::deserialize(report)?),
            fragments_per_lit_pixel: judged.fragments_per_lit_pixel,
            splits: judged.splits,
            entries: log::parse(&entries).map_err(|what| {
                Fault::Data(format!("{}: {what}; remove the folder {folder}", table.display()))
            })?,
        });
        if twin.is_some() {
            return Ok(());
        }
        for &budget in budgets {
            let package = self.path(&folder, &format!("{budget}.aarc"));
            match self.package(variant, &field, &package, budget) {
                Err(error) if is_of_data(&error) => {
                    self.leave_out(&format!("package of {budget}, {}", variant.name), &format!("{error:#}"));
                }
                figures => self.ablation.packages.push(figures?),
            }
        }
        Ok(())
    }

    /// Measures another method, whose `subject` is at `path`.
    pub(super) fn other(&mut self, name: &str, path: &Path, subject: &Subject) -> anyhow::Result<()> {
        let learned = learned_cameras_of(path);
        let judged = self.judge(subject, path, learned, name, &format!("compared-{name}"), "eval")?;
        let images: usize = judged.splits.iter().map(|row| row.images).sum();
        self.ablation.methods.push(Method {
            name: name.into(),
            about: format!("{}, {images} of {} photographs", path.display(), self.images()),
            fit: None,
            fragments_per_lit_pixel: judged.fragments_per_lit_pixel,
            splits: judged.splits,
            entries: Vec::new(),
        });
        Ok(())
    }

    /// Name of an earlier variant whose field has the same bytes as `field`, the field of `variant`.
    fn twin(&self, variant: &Variant, field: &Path) -> Result<Option<&'static str>, Fault> {
        let read = |path: &Path| fs::read(path).map_err(|error| unreadable(path, &error));
        let bytes = read(field)?;
        for earlier in VARIANTS.iter().take_while(|earlier| earlier.name != variant.name) {
            let is_made = self.ablation.methods.iter().any(|method| method.name == earlier.name);
            if is_made && read(&self.path(&earlier.folder(), FIELD))? == bytes {
                return Ok(Some(earlier.name));
            }
        }
        Ok(None)
    }

    /// Fits a field to `field`, unless that is done; returns the JSON of `fit`.
    fn fit(&mut self, plan: &FitPlan, field: &Path) -> anyhow::Result<Value> {
        let key = key(FIT, &format!("{plan:?} {}", self.photographs_key), &[])?;
        let is_whole = (plan.plate != PlatePlan::Fitted || plate_path(field).is_file())
            && (plan.learned.is_nothing() || cameras_path(field).is_file());
        if let Some(report) = Record::report(field, FIT, &key)?.filter(|_| is_whole) {
            return Ok(report);
        }
        if Record::state(field, FIT, &key)? == OutputState::Stale {
            fit::remove_checkpoint(field)?;
        }
        Record::begin(field, FIT, &key)?;
        let mut capture_files = self.capture_files.clone();
        if plan.plate == PlatePlan::None {
            capture_files.forget_mattes();
        }
        if self.views.as_ref().is_none_or(|(plate, _)| *plate != plan.plate) {
            self.views = None;
            let start_files = plan.start_files(&capture_files);
            self.views = Some((plan.plate, load_training_views(&start_files, HOLDOUT)?));
        }
        let (_, views) = self.views.as_mut().context("photographs")?;
        let options = self.options;
        let mut backend = options.open_backend()?;
        let lpips = self.lpips.as_ref().filter(|_| plan.lpips.is_some());
        // A plate changes the responses that its field starts from.
        let responses = views.responses.clone();
        let runtime = options.runtime(&mut *backend, lpips);
        let plate = fit_plate(plan, &mut capture_files, views, runtime, field);
        let runtime = options.runtime(&mut *backend, lpips);
        let fitted = plate
            .and_then(|plate| fit_and_write(field, plan, &capture_files, views, plate.as_ref(), runtime));
        // The next variant starts from them, also after a failure.
        views.responses = responses;
        let fitted = fitted?;
        let splits = self.ablation.photographs.clone();
        // Fragments are counted with the other measures, in the views that the page shows.
        let result = FitResult {
            plan: plan.clone(),
            fitted,
            splits,
            fragments_per_lit_pixel: None,
            held_cameras: None,
        };
        let report = result.to_json(field)?;
        Record::complete(field, FIT, &key, report.clone())?;
        Ok(report)
    }

    /// Packages a field, unless that is done, and measures the decoded package.
    fn package(
        &mut self,
        variant: &Variant,
        field: &Path,
        package: &Path,
        budget: usize,
    ) -> anyhow::Result<PackageFigures> {
        let key = key(PACKAGE, &budget.to_string(), &[field])?;
        let report = match Record::report(package, PACKAGE, &key)? {
            Some(report) => report,
            None => {
                Record::begin(package, PACKAGE, &key)?;
                let settings = PackageSettings { budget: Some(budget), ..PackageSettings::default() };
                let progress = StagedProgress::visible();
                progress.set_prefix(format!("{}, {budget}: ", variant.name));
                let made =
                    package_with(&Scene::load(field)?, &settings, None, &mut Cpu::default(), &progress)?;
                output::write(package, &made.bytes)?;
                let report = serde_json::to_value(made.report)?;
                Record::complete(package, PACKAGE, &key, report.clone())?;
                report
            }
        };
        let PackageRecord { gaussians_out, bytes, duration_s, topology } =
            PackageRecord::deserialize(report)?;
        let subject = Subject::load(package, &self.capture_files)?;
        let (learned, folder) = (Some(cameras_path(field)), variant.folder());
        let judged = self.judge(&subject, package, learned, variant.name, &folder, &budget.to_string())?;
        Ok(PackageFigures {
            method: variant.name.into(),
            budget,
            gaussians: gaussians_out,
            bytes,
            mbps: bytes as f64 * 8e-6 / duration_s,
            topology: topology.recall,
            splits: judged.splits,
        })
    }

    /// Compares the pictures of `subject`, which is at `path`, with the photographs, unless that is done; `learned` is where the
    /// cameras are that its fit learned, if it learned any. Writes the measures to `FILE.csv` in a folder of
    /// the report; of `eval` also pictures, which the page then shows.
    fn judge(
        &mut self,
        subject: &Subject,
        path: &Path,
        learned: Option<PathBuf>,
        name: &str,
        folder: &str,
        file: &str,
    ) -> anyhow::Result<JudgedSubject> {
        output::make_folder(&self.out.join(folder))?;
        let csv = self.path(folder, &format!("{file}.csv"));
        let is_shown = file == "eval";
        let options = format!("{} {:?}", self.photographs_key, self.options.lpips.record()?);
        let learned = learned.filter(|path| path.is_file());
        let inputs: Vec<&Path> = [Some(path), learned.as_deref()].into_iter().flatten().collect();
        let key = key(EVAL, &options, &inputs)?;
        let report = match Record::report(&csv, EVAL, &key)? {
            Some(report) => report,
            None => {
                Record::begin(&csv, EVAL, &key)?;
                let mut judged_files = judged_files(&self.capture_files);
                if let Some(learned) = &learned {
                    judged_files.correct(&CameraCorrections::read(learned)?, learned)?;
                }
                let report = self.compare(subject, &judged_files, name, folder, &csv, is_shown)?;
                Record::complete(&csv, EVAL, &key, report.clone())?;
                report
            }
        };
        if is_shown {
            self.show(name, folder)?;
        }
        // Measures come from the file, so that a second run shows the same ones.
        let text = fs::read_to_string(&csv).map_err(|error| unreadable(&csv, &error))?;
        let judged = parse_csv(&text, &self.capture_files)
            .map_err(|what| Fault::Data(format!("{}: {what}; remove it to measure again", csv.display())))?;
        let fragments_per_lit_pixel = report["fragments_per_lit_pixel"].as_f64();
        Ok(JudgedSubject { splits: eval::means(&judged), fragments_per_lit_pixel })
    }

    /// Writes measures to `csv`, and pictures beside it if `is_shown`; returns the other figures.
    fn compare(
        &self,
        subject: &Subject,
        judged_files: &CaptureFiles,
        name: &str,
        folder: &str,
        csv: &Path,
        is_shown: bool,
    ) -> anyhow::Result<Value> {
        let progress = counting(self.images() as u64, "photographs");
        progress.set_message(name.to_owned());
        // Difference mattes tell the subject in all rows: what each fit draws before its plate differs from row to row.
        let photographs = Photographs::new(judged_files, false);
        let judged = judge(subject, &photographs, HOLDOUT, self.lpips.as_ref(), |comparison| {
            progress.inc(1);
            let Some(comparison) = comparison.filter(|_| is_shown) else { return Ok(()) };
            match self.pictured.iter().find(|photo| photo.photo_id == comparison.photo_id) {
                Some(photo) => {
                    let picture = photo.crop.apply(comparison.picture);
                    write_picture(&self.path(folder, &photo.file), &picture)
                }
                None => Ok(()),
            }
        })?;
        progress.finish_and_clear();
        output::write(csv, eval::csv(&judged, &self.capture_files).as_bytes())?;
        let fragments = match subject {
            Subject::Drawn(input) if is_shown => {
                let photos = self.pictured.iter().map(|photo| &photo.photo_id);
                fragments_per_lit_pixel(&input.to_reference(), judged_files, photos)
            }
            _ => None,
        };
        Ok(json!({"fragments_per_lit_pixel": fragments}))
    }
}
