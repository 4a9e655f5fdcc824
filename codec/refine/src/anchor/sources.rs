//! The surfaces that the views of a frame see, from the chosen [`DepthSource`].

use glam::DVec3;

use super::align::{self, Affine};
use super::ground::{self, Surface};
use super::hull::Hull;
use super::pinhole::{Pinhole, rig_radius};
use super::silhouette::Silhouette;
use super::{
    Alignment, AnchorError, AnchorFrame, AnchorSettings, AnchorView, DepthMap, DepthSource, HullSettings,
    mirror, open, sweep,
};
use crate::fit::Photograph;
use crate::median::median;

/// The surfaces of a frame.
pub(super) struct FrameSurfaces<'a> {
    /// One surface per grounding view.
    pub(super) surfaces: Vec<Surface<'a>>,
    /// Distance in pixels between sampled rays.
    pub(super) step: f64,
    /// Centroid of the hull, if there is one.
    pub(super) hull_center: Option<DVec3>,
}

/// Finds the surfaces that the grounding views see, sampled at about `rays` of their pixels. `scale` is
/// the factor of [`Alignment::Rig`]; the first frame that determines it sets it.
// Long: one arm a source of depth.
pub(super) fn surfaces<'a>(
    settings: &AnchorSettings,
    frame: &'a AnchorFrame,
    rays: f64,
    scale: &mut Option<f64>,
) -> Result<FrameSurfaces<'a>, AnchorError> {
    let views = &frame.views;
    check_sizes(frame)?;
    let grounding = grounding(settings, frame);
    if !grounding.contains(&true) {
        return Err(AnchorError::NoViews);
    }
    let pinholes = pinholes(frame);
    let hull = match settings.source {
        DepthSource::Given(Alignment::Metric | Alignment::Rig) => None,
        DepthSource::HullAndSweep if !views.iter().any(|view| view.photograph.is_masked()) => None,
        DepthSource::Hull | DepthSource::HullAndSweep | DepthSource::Given(Alignment::Hull) => {
            Some(carved(&pinholes, views, settings.hull)?)
        }
    };
    // The number of pixels with given depths is known after their alignment.
    let mut step = match settings.source {
        DepthSource::Hull | DepthSource::HullAndSweep => {
            let subject = |view: &AnchorView| {
                (0..view.photograph.pixels.len()).filter(|i| view.photograph.is_subject(*i)).count()
            };
            ground::step(selected(views, &grounding).map(subject).sum(), rays)
        }
        DepthSource::Given(_) => 1.0,
    };
    let mut surfaces: Vec<Surface> = (0..views.len())
        .filter(|i| grounding[*i])
        .map(|i| hull_surface(&pinholes[i], &views[i].photograph, hull.as_ref(), step))
        .collect();
    match (settings.source, &hull) {
        (DepthSource::HullAndSweep, hull) => {
            let pairs: Vec<_> = pinholes.iter().zip(views.iter().map(|view| &view.photograph)).collect();
            let swept = match hull {
                Some(hull) => sweep::sweep(settings.sweep, hull, &pairs, &grounding),
                None => open::sweep(&pairs, &grounding).ok_or(AnchorError::OnePlace)?,
            };
            let swept = swept.into_iter().zip(&grounding).filter(|(_, grounding)| **grounding);
            for (surface, (depths, _)) in surfaces.iter_mut().zip(swept) {
                surface.depths = depths;
            }
        }
        (DepthSource::Given(alignment), _) => {
            let given: Vec<Option<&DepthMap>> =
                selected(views, &grounding).map(|view| view.depths.as_ref()).collect();
            if alignment == Alignment::Rig && scale.is_none() {
                *scale = Some(rig_scale(&pinholes, &surfaces, &given)?);
            }
            for (surface, map) in surfaces.iter_mut().zip(given) {
                surface.depths = aligned(surface, map, alignment, *scale);
            }
            if surfaces.iter().all(|surface| surface.pixels() == 0) {
                return Err(AnchorError::NoDepths);
            }
            step = ground::step(surfaces.iter().map(Surface::pixels).sum(), rays);
        }
        _ => (),
    }
    Ok(FrameSurfaces { surfaces, step, hull_center: hull.map(|hull| hull.centroid()) })
}

/// The depth maps of [`hull_depths`](super::hull_depths).
pub(super) fn hull_depths(frame: &AnchorFrame, settings: HullSettings) -> Result<Vec<DepthMap>, AnchorError> {
    check_sizes(frame)?;
    let (pinholes, views) = (pinholes(frame), &frame.views);
    let hull = carved(&pinholes, views, settings)?;
    let map = |(pinhole, view): (&Pinhole, &AnchorView)| {
        hull_surface(pinhole, &view.photograph, Some(&hull), 1.0).depths
    };
    Ok(pinholes.iter().zip(views).map(map).collect())
}

/// The hull of the silhouettes of all views.
fn carved(pinholes: &[Pinhole], views: &[AnchorView], settings: HullSettings) -> Result<Hull, AnchorError> {
    let silhouettes =
        pinholes.iter().zip(views).map(|(pinhole, view)| Silhouette::new(pinhole, &view.photograph));
    Hull::carve(silhouettes.collect(), settings)
}

/// Checks that each photograph has the size of its camera.
fn check_sizes(frame: &AnchorFrame) -> Result<(), AnchorError> {
    let has_size = |AnchorView { camera, photograph, .. }: &AnchorView| {
        let size = (photograph.width, photograph.height);
        let pixels = size.0 as usize * size.1 as usize;
        size == (camera.width, camera.height) && photograph.pixels.len() == pixels
    };
    match frame.views.iter().find(|view| !has_size(view)) {
        Some(view) => Err(AnchorError::Size { frame: frame.frame, camera: view.camera_id }),
        None => Ok(()),
    }
}

/// The surface of a view with the depths of `hull` at every `step`-th pixel; without a hull, no depths.
fn hull_surface<'a>(
    pinhole: &Pinhole,
    photograph: &'a Photograph,
    hull: Option<&Hull>,
    step: f64,
) -> Surface<'a> {
    let [width, height] = pinhole.size;
    let sampled = |size: u32| {
        let mut sampled = vec![false; size as usize];
        ground::lattice(step, size).for_each(|at| sampled[at as usize] = true);
        sampled
    };
    let (columns, rows) = (sampled(width), sampled(height));
    let is_sampled = |pixel: usize| {
        let (x, y) = (pixel % width as usize, pixel / width as usize);
        columns[x] && rows[y] && photograph.is_subject(pixel)
    };
    let spans = hull.map(|hull| hull.spans(pinhole, is_sampled)).unwrap_or_default();
    let depths = DepthMap { width, height, depths: spans.iter().map(|span| span[0]).collect() };
    Surface { pinhole: pinhole.clone(), photograph, depths, spans }
}

/// The scale of [`Alignment::Rig`].
fn rig_scale(
    pinholes: &[Pinhole],
    surfaces: &[Surface],
    given: &[Option<&DepthMap>],
) -> Result<f64, AnchorError> {
    let radius = rig_radius(pinholes).ok_or(AnchorError::NoRig)?;
    let known = surfaces.iter().zip(given).flat_map(|(surface, map)| known(surface, *map));
    let depth = median(known.map(|(_, depth)| depth).collect()).ok_or(AnchorError::NoDepths)?;
    Ok(radius / depth)
}

/// Mean viewing direction of the grounding views, if they are on one side.
pub(super) fn front(settings: &AnchorSettings, frame: &AnchorFrame) -> Option<DVec3> {
    let rig = pinholes(frame);
    let views: Vec<Pinhole> = selected(&rig, &grounding(settings, frame)).cloned().collect();
    mirror::front(&views, &rig)
}

fn pinholes(frame: &AnchorFrame) -> Vec<Pinhole> {
    frame.views.iter().map(|view| Pinhole::new(&view.camera)).collect()
}

/// Whether each view puts Gaussians on its rays.
fn grounding(settings: &AnchorSettings, frame: &AnchorFrame) -> Vec<bool> {
    let named =
        |view: &AnchorView| settings.views.as_ref().is_none_or(|named| named.contains(&view.camera_id));
    frame.views.iter().map(named).collect()
}

/// The items whose flag is set.
fn selected<'a, T>(items: &'a [T], flags: &'a [bool]) -> impl Iterator<Item = &'a T> {
    items.iter().zip(flags).filter(|(_, flag)| **flag).map(|(item, _)| item)
}

/// Pixels of the subject with a known depth in `map`, and the depth.
fn known(surface: &Surface, map: Option<&DepthMap>) -> Vec<(usize, f64)> {
    let [width, height] = surface.pinhole.size;
    let depth = |pixel: usize| {
        let at = [pixel as u32 % width, pixel as u32 / width];
        let depth = map?.at(at, surface.pinhole.size).filter(|_| surface.photograph.is_subject(pixel))?;
        Some((pixel, f64::from(depth)))
    };
    (0..(width * height) as usize).filter_map(depth).collect()
}

/// The map in units of the capture; an empty map, which grounds no Gaussians, if alignment fails.
fn aligned(surface: &Surface, map: Option<&DepthMap>, alignment: Alignment, scale: Option<f64>) -> DepthMap {
    let affine = match alignment {
        Alignment::Metric => Some(Affine { scale: 1.0, shift: 0.0 }),
        Alignment::Rig => scale.map(|scale| Affine { scale, shift: 0.0 }),
        Alignment::Hull => {
            let hull_pair = |(pixel, depth): (usize, f64)| (depth, f64::from(surface.spans[pixel][0]));
            let pairs = known(surface, map).into_iter().map(hull_pair).filter(|(_, hull)| *hull > 0.0);
            align::robust(&pairs.collect::<Vec<_>>())
        }
    };
    match (affine, map) {
        (Some(affine), Some(map)) => affine.apply(map),
        _ => DepthMap { width: 0, height: 0, depths: Vec::new() },
    }
}
