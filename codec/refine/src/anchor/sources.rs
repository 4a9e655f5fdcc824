//! The surfaces of a frame, from the source of depths that is asked for.

use glam::DVec3;

use super::align::{self, Affine};
use super::eye::{Eye, rig_radius};
use super::ground::{self, Surface};
use super::hull::Hull;
use super::silhouette::Silhouette;
use super::{
    Alignment, Anchor, AnchorError, AnchorFrame, AnchorView, DepthMap, Found, Source, mirror, sweep,
};
use crate::median::median;

/// What the views that ground an anchor see: about `rays` of their pixels, all where there are fewer.
/// `scale` is what depths are multiplied by under [`Alignment::Rig`], found in the first frame that
/// tells it.
pub(super) fn surfaces<'a>(
    settings: &Anchor,
    frame: &'a AnchorFrame,
    rays: f64,
    scale: &mut Option<f64>,
) -> Result<Found<'a>, AnchorError> {
    let views = &frame.views;
    for AnchorView { camera_id, camera, photograph, .. } in views {
        let size = (photograph.width, photograph.height);
        let pixels = size.0 as usize * size.1 as usize;
        if size != (camera.width, camera.height) || photograph.pixels.len() != pixels {
            return Err(AnchorError::Size { frame: frame.frame, camera: *camera_id });
        }
    }
    let wanted = wanted(settings, frame);
    if !wanted.contains(&true) {
        return Err(AnchorError::NoViews);
    }
    let eyes = eyes(frame);
    let hull = match settings.source {
        Source::Given(Alignment::Metric | Alignment::Rig) => None,
        Source::Hull | Source::HullAndSweep | Source::Given(Alignment::Hull) => {
            let silhouettes =
                eyes.iter().zip(views).map(|(eye, view)| Silhouette::new(eye, &view.photograph));
            Some(Hull::carve(silhouettes.collect(), settings.hull)?)
        }
    };
    // Given depths decide themselves which pixels there are.
    let step = match settings.source {
        Source::Hull | Source::HullAndSweep => {
            let of = |view: &AnchorView| {
                (0..view.photograph.pixels.len()).filter(|i| view.photograph.is_subject(*i)).count()
            };
            ground::step(views.iter().zip(&wanted).filter(|(_, w)| **w).map(|(view, _)| of(view)).sum(), rays)
        }
        Source::Given(_) => 1.0,
    };
    let mut surfaces: Vec<Surface> = (0..views.len())
        .filter(|i| wanted[*i])
        .map(|i| {
            let (eye, photograph) = (&eyes[i], &views[i].photograph);
            let [width, height] = eye.size;
            let sampled = |size: u32| {
                let mut sampled = vec![false; size as usize];
                ground::lattice(step, size).for_each(|at| sampled[at as usize] = true);
                sampled
            };
            let (columns, rows) = (sampled(width), sampled(height));
            let wanted = |pixel: usize| {
                let (x, y) = (pixel % width as usize, pixel / width as usize);
                columns[x] && rows[y] && photograph.is_subject(pixel)
            };
            let spans = hull.as_ref().map(|hull| hull.spans(eye, wanted)).unwrap_or_default();
            // Of the hull, until there are better ones.
            let depths = DepthMap { width, height, depths: spans.iter().map(|span| span[0]).collect() };
            Surface { eye: eye.clone(), photograph, depths, spans }
        })
        .collect();
    match (settings.source, &hull) {
        (Source::HullAndSweep, Some(hull)) => {
            let pairs: Vec<_> = eyes.iter().zip(views.iter().map(|view| &view.photograph)).collect();
            let swept = sweep::sweep(settings.sweep, hull, &pairs, &wanted);
            let swept = swept.into_iter().zip(&wanted).filter(|(_, wanted)| **wanted);
            for (surface, (depths, _)) in surfaces.iter_mut().zip(swept) {
                surface.depths = depths;
            }
        }
        (Source::Given(alignment), _) => {
            let given: Vec<Option<&DepthMap>> = views
                .iter()
                .zip(&wanted)
                .filter(|(_, w)| **w)
                .map(|(view, _)| view.depths.as_ref())
                .collect();
            if alignment == Alignment::Rig && scale.is_none() {
                let radius = rig_radius(&eyes).ok_or(AnchorError::NoRig)?;
                let known = surfaces.iter().zip(&given).flat_map(|(surface, map)| known(surface, *map));
                let middle = median(known.map(|(_, depth)| depth).collect());
                *scale = Some(radius / middle.ok_or(AnchorError::NoDepths)?);
            }
            for (surface, map) in surfaces.iter_mut().zip(given) {
                surface.depths = aligned(surface, map, alignment, *scale);
            }
            if surfaces.iter().all(|surface| surface.pixels() == 0) {
                return Err(AnchorError::NoDepths);
            }
        }
        _ => (),
    }
    let step = match settings.source {
        Source::Given(_) => ground::step(surfaces.iter().map(Surface::pixels).sum(), rays),
        _ => step,
    };
    Ok(Found { surfaces, step, middle: hull.map(|hull| hull.centroid()) })
}

/// Where the views that ground an anchor look, if from one side.
pub(super) fn front(settings: &Anchor, frame: &AnchorFrame) -> Option<DVec3> {
    let (rig, wanted) = (eyes(frame), wanted(settings, frame));
    let grounding: Vec<Eye> =
        rig.iter().zip(wanted).filter(|(_, w)| *w).map(|(eye, _)| eye.clone()).collect();
    mirror::front(&grounding, &rig)
}

fn eyes(frame: &AnchorFrame) -> Vec<Eye> {
    frame.views.iter().map(|view| Eye::new(&view.camera)).collect()
}

/// Of each view, whether it is to put Gaussians on its rays.
fn wanted(settings: &Anchor, frame: &AnchorFrame) -> Vec<bool> {
    let named =
        |view: &AnchorView| settings.views.as_ref().is_none_or(|named| named.contains(&view.camera_id));
    frame.views.iter().map(named).collect()
}

/// The pixels of the subject whose depth a map knows, and it.
fn known(surface: &Surface, map: Option<&DepthMap>) -> Vec<(usize, f64)> {
    let [width, height] = surface.eye.size;
    let depth = |pixel: usize| {
        let at = [pixel as u32 % width, pixel as u32 / width];
        let depth = map?.at(at, surface.eye.size).filter(|_| surface.photograph.is_subject(pixel))?;
        Some((pixel, f64::from(depth)))
    };
    (0..(width * height) as usize).filter_map(depth).collect()
}

/// A map in units of the capture, or an empty one, which puts no Gaussians anywhere.
fn aligned(surface: &Surface, map: Option<&DepthMap>, alignment: Alignment, scale: Option<f64>) -> DepthMap {
    let affine = match alignment {
        Alignment::Metric => Some(Affine { scale: 1.0, shift: 0.0 }),
        Alignment::Rig => scale.map(|scale| Affine { scale, shift: 0.0 }),
        Alignment::Hull => {
            let of_hull = |(pixel, depth): (usize, f64)| (depth, f64::from(surface.spans[pixel][0]));
            let pairs = known(surface, map).into_iter().map(of_hull).filter(|(_, hull)| *hull > 0.0);
            align::robust(&pairs.collect::<Vec<_>>())
        }
    };
    match (affine, map) {
        (Some(affine), Some(map)) => affine.apply(map),
        _ => DepthMap { width: 0, height: 0, depths: Vec::new() },
    }
}
