//! This project's own field file, as `xtask/FIELD.md` specifies it and [`crate::import`] reads it.

use codec::{ClipInfo, Field};
use refine::capture::Holdout;

use super::ply::{binary_ply, filter_comment, metadata, push_static, static_names};
use crate::import::field_file::{MARK, VERSION};

/// A field and the metadata of its clip, without loss.
pub fn field_file(field: &Field, info: &ClipInfo) -> Vec<u8> {
    with_holdout(field, info, None)
}

/// A fitted field, as [`field_file`] writes it, with a record of the frames held out from fitting.
pub fn fitted_field_file(field: &Field, info: &ClipInfo, holdout: Holdout) -> Vec<u8> {
    with_holdout(field, info, Some(holdout))
}

fn with_holdout(field: &Field, info: &ClipInfo, holdout: Option<Holdout>) -> Vec<u8> {
    let mut comments = vec![format!("{MARK} field {VERSION}")];
    comments.extend(metadata(info));
    comments.extend(filter_comment(field.filter));
    comments.extend(holdout.map(|holdout| format!("{MARK} holdout {}", holdout.name())));
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
