//! This project's own field file, as `xtask/FIELD.md` specifies it and [`crate::import`] reads it.

use codec::{ClipInfo, Field};
use refine::capture::Holdout;

use super::ply::{binary_ply, push_static, static_names};
use crate::import::field_file::{MARK, VERSION};

/// A field and the metadata of its clip, without loss.
pub fn field_file(field: &Field, info: &ClipInfo) -> Vec<u8> {
    with_comments(field, metadata(info))
}

/// A fitted field, as [`field_file`] writes it, with a record of the frames held out from fitting.
pub fn fitted_field_file(field: &Field, info: &ClipInfo, holdout: Holdout) -> Vec<u8> {
    let mut comments = metadata(info);
    comments.push(format!("{MARK} holdout {}", holdout.name()));
    with_comments(field, comments)
}

fn with_comments(field: &Field, comments: Vec<String>) -> Vec<u8> {
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

/// The metadata comments. Rust prints the shortest digits that read back as the same number.
fn metadata(info: &ClipInfo) -> Vec<String> {
    let vector = |v: [f32; 3]| format!("{} {} {}", v[0], v[1], v[2]);
    let mut comments = vec![
        format!("{MARK} field {VERSION}"),
        format!("{MARK} duration_s {}", info.duration_s),
        format!("{MARK} fps {}", info.fps),
        format!("{MARK} up {}", vector(info.up)),
        format!("{MARK} metres_per_unit {}", info.metres_per_unit),
    ];
    comments.extend(info.viewpoints.iter().map(|view| {
        let name = view.name.replace(char::is_control, " ");
        let (position, target) = (vector(view.position), vector(view.target));
        format!("{MARK} viewpoint {position} {target} {} {name}", view.fov_y)
    }));
    comments
}
