//! PLY of FreeTimeGS (Wang et al. 2025) and its kin: linear velocity, and a time and a duration per Gaussian.
//!
//! The columns of 3D Gaussian Splatting, and a velocity `vx vy vz` (or `velocity_x`, `velocity_y`, `velocity_z`) in
//! units per clip, a `time` (or `t`) in clip time, and a `duration` (or `dt`), the standard deviation of the window in
//! clip time. The authors publish no file format: programs that follow the paper write these names, and the logarithm
//! of the duration where the network's parameters are written as they are.

use crate::imported::Imported;
use crate::limits::ImportBudget;

use super::container::Table;
use super::gaussian_splatting;

/// What is assumed of any file.
const ASSUMED: &str = "velocities are per clip, times and durations in clip time, and a duration is the standard \
                       deviation of a window; the format is not specified";

/// What is assumed of a file with durations below zero.
const ASSUMED_LOGARITHMS: &str = "durations are logarithms, since some are below zero";

/// Names of the velocity, of the time and of the duration.
fn names(vertex: &Table) -> Option<([&'static str; 3], &'static str, &'static str)> {
    let velocities = [["vx", "vy", "vz"], ["velocity_x", "velocity_y", "velocity_z"]];
    let has = |name: &&str| vertex.has(name);
    let velocity = velocities.into_iter().find(|names| names.iter().all(|name| vertex.has(name)))?;
    let time = ["time", "t"].into_iter().find(has)?;
    Some((velocity, time, ["duration", "dt"].into_iter().find(has)?))
}

/// Whether a table has the columns of this format.
pub(super) fn is_one(vertex: &Table) -> bool {
    names(vertex).is_some()
}

/// Reads the rows of a dynamic field.
pub(super) fn read(vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    let (velocity, time, duration) = names(vertex).ok_or("PLY without velocity, time and duration")?;
    let mut imported = gaussian_splatting::read(vertex, budget)?;
    let velocity = vertex.find(velocity)?;
    let [time, duration] = vertex.find([time, duration])?;
    let are_logarithms = (0..vertex.rows).any(|row| vertex.get(row, duration) < 0.0);
    let mut temporal = budget.temporal(vertex.rows, 1)?;
    for row in 0..vertex.rows {
        let stored = vertex.get(row, duration);
        temporal.tau.push(vertex.get(row, time) as f32);
        temporal.s.push(if are_logarithms { stored.exp() } else { stored } as f32);
        temporal.motion.push(vertex.row(row, velocity));
    }
    imported.field.temporal = Some(temporal);
    imported.account.assumed.push(ASSUMED.into());
    imported.account.assumed.extend(are_logarithms.then(|| ASSUMED_LOGARITHMS.into()));
    Ok(Imported { format: "FreeTimeGS PLY", ..imported })
}
