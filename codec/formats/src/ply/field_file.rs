//! This project's own field file: a lossless superset of the PLY of 3D Gaussian Splatting, specified in
//! `xtask/FIELD.md`.

use codec::{ClipInfo, Field, MOTION_ORDER_MAX};

use crate::imported::Imported;
use crate::limits::ImportBudget;

use super::comments;
use super::container::{self, Table};
use super::gaussian_splatting::{self, push_static, static_names};

/// Name of the opacity in `[0, 1]`: the logit beside it rounds.
const OPACITY: &str = "aarc_opacity";

/// Names of a window's centre and standard deviation.
const WINDOW: [&str; 2] = ["tau", "s"];

/// Names of the motion coefficients of a power, from 1.
fn motion_names(power: u8) -> [String; 3] {
    ["x", "y", "z"].map(|axis| format!("motion_{power}_{axis}"))
}

/// Names of the rates of the quaternion.
fn rate_names() -> [String; 4] {
    [0, 1, 2, 3].map(|k| format!("rot_rate_{k}"))
}

/// Reads the rows of a field.
pub(super) fn read(vertex: &Table, budget: &mut ImportBudget) -> Result<Imported, String> {
    let mut imported = gaussian_splatting::read(vertex, budget)?;
    let field = &mut imported.field;
    let rows = 0..vertex.rows;
    if vertex.has(OPACITY) {
        let [exact] = vertex.find([OPACITY])?;
        field.opacities.clear();
        field.opacities.extend(rows.clone().map(|row| vertex.get(row, exact) as f32));
    }
    if vertex.has(WINDOW[0]) {
        let [tau, s] = vertex.find(WINDOW)?;
        let powers: Vec<[usize; 3]> = (1..=MOTION_ORDER_MAX)
            .map(motion_names)
            .take_while(|[first, ..]| vertex.has(first))
            .map(|names| vertex.find(names))
            .collect::<Result<_, _>>()?;
        let names = rate_names();
        let rates = vertex.has(&names[0]).then(|| vertex.find(names)).transpose()?;
        let mut temporal = budget.temporal(vertex.rows, powers.len() as u8)?;
        for row in rows.clone() {
            temporal.tau.push(vertex.get(row, tau) as f32);
            temporal.s.push(vertex.get(row, s) as f32);
            temporal.motion.extend(powers.iter().map(|&power| vertex.row(row, power)));
        }
        if let Some(rates) = rates {
            let mut column = budget.vec(vertex.rows)?;
            column.extend(rows.map(|row| vertex.row(row, rates)));
            temporal.rotation_rates = Some(column);
        }
        field.temporal = Some(temporal);
    }
    Ok(Imported { format: "field file", ..imported })
}

/// A field and the metadata of its clip, without loss.
pub fn write_field_file(field: &Field, info: &ClipInfo) -> Vec<u8> {
    write_commented_field_file(field, info, &[])
}

/// A field, as [`write_field_file`] writes it, with further comments, each a key and its value, which
/// [`crate::Hints::comments`] has when the file is read.
pub fn write_commented_field_file(field: &Field, info: &ClipInfo, further: &[(&str, String)]) -> Vec<u8> {
    let mut comments = vec![comments::mark()];
    comments.extend(comments::on_clip(info));
    comments.extend(comments::on_drawing(field));
    comments.extend(further.iter().map(|(key, value)| comments::comment(key, value)));
    let mut names = static_names(field.sh_degree);
    names.push(OPACITY.into());
    if let Some(temporal) = &field.temporal {
        names.extend(WINDOW.map(String::from));
        names.extend((1..=temporal.motion_order).flat_map(motion_names));
        if temporal.rotation_rates.is_some() {
            names.extend(rate_names());
        }
    }
    container::write(&comments, &names, field.len(), |i, row| {
        push_static(field, i, row);
        row.push(field.opacities[i]);
        if let Some(temporal) = &field.temporal {
            row.extend([temporal.tau[i], temporal.s[i]]);
            row.extend(temporal.motion_of(i).iter().flatten());
            row.extend(temporal.rotation_rates.iter().flat_map(|rates| rates[i]));
        }
    })
}
