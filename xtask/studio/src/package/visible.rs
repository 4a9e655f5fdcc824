//! [`visible_scene`]: the Gaussians of a scene that are visible at some instant, without dropped parts.

use std::collections::BTreeMap;

use codec::{ALPHA_MIN, Field};
use formats::{Imported, Repairs};
use program::Fault;
use refine::prune::{contributions_to, instants, posed_views};

use super::report::Counts;
use super::settings::{DropPart, PackageSettings};
use super::views::{stand_points, unseen};
use crate::scene::Scene;

/// Instants at which the rims of Gaussians are looked for, at most: in larger pictures, which take longer.
const RIM_INSTANTS: usize = 16;

/// The visible Gaussians of a scene, without the dropped parts.
pub(crate) struct VisibleScene {
    pub(crate) field: Field,
    pub(super) subject: Counts,
    pub(crate) plate: Option<Field>,
    pub(super) plate_counts: Option<Counts>,
    pub(super) parts_removed: BTreeMap<&'static str, usize>,
}

/// Selects the visible Gaussians of a scene and removes the parts to drop.
///
/// # Errors
/// [`Fault::Data`] where no Gaussian is visible, or `strict` refuses a repair.
pub(crate) fn visible_scene(scene: &Scene, settings: &PackageSettings) -> Result<VisibleScene, Fault> {
    if settings.strict {
        check_repairs(scene)?;
    }
    let drop = |part| settings.drop.contains(&part);
    let mut parts_removed = BTreeMap::new();

    let (mut field, mut subject) = visible(&scene.subject);
    let mut background = scene.plate.as_ref().map(visible);
    if drop(DropPart::Plate)
        && let Some((plate, _)) = background.take()
    {
        parts_removed.insert("plate", plate.len());
    }
    for part in [DropPart::Angular, DropPart::Sh] {
        if drop(part) {
            let plate = background.as_mut().map(|(plate, _)| plate);
            let removed = [Some(&mut field), plate].into_iter().flatten().map(|field| remove(part, field));
            parts_removed.insert(if part == DropPart::Sh { "sh" } else { "angular" }, removed.sum());
        }
    }

    if drop(DropPart::Unseen) {
        let hidden = hidden(scene, &field, background.as_ref().map(|(plate, _)| plate));
        let plate = background.as_mut().map(|(plate, counts)| (plate, counts));
        let parts = [Some((&mut field, &mut subject)), plate];
        for ((part, counts), is_hidden) in parts.into_iter().flatten().zip(hidden) {
            let all = part.len();
            *part = part.select(&(0..all).filter(|row| !is_hidden[*row]).collect::<Vec<_>>());
            counts.drop("seen from nowhere people stand", all - part.len());
            counts.gaussians_out = part.len();
        }
    }

    if field.is_empty() {
        let what = if drop(DropPart::Unseen) { ", or leave --drop unseen out" } else { "" };
        return Err(Fault::Data(format!(
            "{}: it has no Gaussian that can be seen; check its opacities and times{what}",
            scene.name
        )));
    }
    let (plate, plate_counts) = background.unzip();
    // A plate without a visible Gaussian is dropped.
    let plate = plate.filter(|plate| !plate.is_empty());
    Ok(VisibleScene { field, subject, plate, plate_counts, parts_removed })
}

/// Refuses a scene with a row that was changed or left out on import.
///
/// # Errors
/// [`Fault::Data`] that says how many and why.
pub(crate) fn check_repairs(scene: &Scene) -> Result<(), Fault> {
    let refused = |what: &str, repairs: &Repairs| match repairs.is_empty() {
        true => Ok(()),
        false => Err(Fault::Data(format!(
            "{what}: {repairs}, which --strict refuses; correct the file, or leave --strict out"
        ))),
    };
    refused(&scene.name, &scene.subject.account.repairs)?;
    scene.plate.as_ref().map_or(Ok(()), |plate| refused("the background plate", &plate.account.repairs))
}

/// The rows that are visible at some instant of the clip, and counts of the others.
pub(crate) fn visible(imported: &Imported) -> (Field, Counts) {
    let (field, repairs) = (&imported.field, &imported.account.repairs);
    let rows: Vec<usize> = (0..field.len()).filter(|&i| field.alive_interval(i).is_some()).collect();
    let mut counts = Counts {
        gaussians_in: field.len() + repairs.dropped.values().sum::<usize>(),
        gaussians_out: rows.len(),
        dropped: repairs.dropped.clone(),
        repaired: repairs.repaired.clone(),
    };
    let culled = field.opacities.iter().filter(|&&opacity| f64::from(opacity) < ALPHA_MIN).count();
    counts.drop("opacity below 1/255", culled);
    counts.drop("never visible within the clip", field.len() - rows.len() - culled);
    (field.select(&rows), counts)
}

/// Whether no place shows anything of each row of `field`, and of `plate`, where people stand, not even a rim.
fn hidden(scene: &Scene, field: &Field, plate: Option<&Field>) -> [Vec<bool>; 2] {
    let cameras = stand_points(scene);
    let is_hidden = |part: &Field, unseen: Vec<usize>| {
        let mut is_hidden = vec![false; part.len()];
        if !unseen.is_empty() {
            let views = posed_views(&cameras, &instants(part, RIM_INSTANTS));
            let seen = contributions_to(&views, part, || ());
            unseen.into_iter().for_each(|row| is_hidden[row] = seen[row].weight_max < ALPHA_MIN);
        }
        is_hidden
    };
    let [of_field, of_plate] = unseen(scene, field, plate, &cameras);
    [is_hidden(field, of_field), plate.map_or_else(Vec::new, |plate| is_hidden(plate, of_plate))]
}

/// Removes a part of every Gaussian; returns how many had it.
fn remove(part: DropPart, field: &mut Field) -> usize {
    match part {
        DropPart::Angular => {
            let rates = field.temporal.as_mut().and_then(|temporal| temporal.rotation_rates.take());
            rates.unwrap_or_default().iter().filter(|rate| **rate != [0.0; 4]).count()
        }
        DropPart::Sh => {
            let has_sh = |i: &usize| field.sh_of(*i)[1..].iter().any(|c| *c != [0.0; 3]);
            let count = (0..field.len()).filter(has_sh).count();
            field.sh = (0..field.len()).map(|i| field.sh_of(i)[0]).collect();
            field.sh_degree = 0;
            count
        }
        DropPart::Plate | DropPart::Unseen => 0,
    }
}
