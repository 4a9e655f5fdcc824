//! This project's own field file, as `xtask/FIELD.md` specifies it and [`crate::import`] reads it.

use codec::{ClipInfo, Field};

use super::ply::{binary_ply, drawing_comments, metadata, push_static, static_names};
use crate::import::FitRecord;
use crate::import::field_file::{MARK, VERSION};

/// A field and the metadata of its clip, without loss.
pub fn field_file(field: &Field, info: &ClipInfo) -> Vec<u8> {
    fitted_field_file(field, info, &FitRecord::default())
}

/// A fitted field, as [`field_file`] writes it, with a record of the photographs that it was fitted to.
pub fn fitted_field_file(field: &Field, info: &ClipInfo, record: &FitRecord) -> Vec<u8> {
    let mut comments = vec![format!("{MARK} field {VERSION}")];
    comments.extend(metadata(info));
    comments.extend(drawing_comments(field));
    comments.extend(record.comments().map(|(key, value)| format!("{MARK} {key} {value}")));
    let mut names = static_names(field.sh_degree);
    names.push("aarc_opacity".into());
    if let Some(temporal) = &field.temporal {
        names.extend(["tau".into(), "s".into()]);
        names.extend(
            (1..=temporal.motion_order)
                .flat_map(|power| ["x", "y", "z"].map(|axis| format!("motion_{power}_{axis}"))),
        );
        if temporal.rotation_rates.is_some() {
            names.extend((0..4).map(|k| format!("rot_rate_{k}")));
        }
    }
    binary_ply(&comments, &names, field.len(), |i, row| {
        push_static(field, i, row);
        row.push(field.opacities[i]);
        if let Some(temporal) = &field.temporal {
            row.extend([temporal.tau[i], temporal.s[i]]);
            row.extend(temporal.motion_of(i).iter().flatten());
            row.extend(temporal.rotation_rates.iter().flat_map(|rates| rates[i]));
        }
    })
}
