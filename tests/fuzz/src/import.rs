//! Imports any bytes as a fitted field.

use std::sync::OnceLock;

use formats::Imported;
use studio::fields::import;
use studio::scene::Scene;

use crate::files::{InputFiles, check_refusal};
use crate::kinds::import::*;
use crate::parts;
use crate::seeds::{one_gaussian, sog_files};

/// Imports an input.
///
/// # Panics
/// If an accepted field is invalid, or a refusal is not one line.
pub fn check_import(bytes: &[u8]) {
    static FILES: OnceLock<InputFiles> = OnceLock::new();
    let sog = || sog_files().into_iter().map(|(name, bytes)| (format!("sog/{name}"), bytes));
    let files = FILES.get_or_init(|| InputFiles::new(sog()));
    let Some((kind, bytes)) = parts::split_kind(bytes, KINDS) else { return };
    // No extension, so that the bytes determine the format.
    let mut name = "field".to_owned();
    let mut restored = None;
    match kind {
        FILE => files.put("field", bytes),
        SPLAT => {
            name.push_str(".splat");
            files.put(&name, bytes);
        }
        KSPLAT | GLTF => {
            name.push_str(if kind == KSPLAT { ".ksplat" } else { ".gltf" });
            files.put(&name, bytes);
        }
        FRAME => return check_frame(files, bytes),
        SOG_META => {
            name = "sog".into();
            files.put("sog/meta.json", bytes);
            restored = sog().find(|(path, _)| path == "sog/meta.json");
        }
        _ => {
            name = "sog".into();
            let Some((which, bytes)) = bytes.split_first() else { return };
            restored = sog().skip(1).nth(usize::from(*which) % (sog().count() - 1));
            files.put(&restored.as_ref().expect("the index is in range").0, bytes);
        }
    }
    let imported = import(&files.path(name));
    if let Some((path, bytes)) = restored {
        files.put(path, &bytes);
    }
    check(imported);
}

/// Imports two sequences of an input: as the last frame, with two frames of one Gaussian before, so that rows differ or
/// there is one; and as all three frames, so that all its rows correspond.
fn check_frame(files: &InputFiles, bytes: &[u8]) {
    static BEFORE: OnceLock<Vec<u8>> = OnceLock::new();
    let before = &BEFORE.get_or_init(one_gaussian)[..];
    for frames in [[before, before, bytes], [bytes; 3]] {
        for (frame, bytes) in frames.into_iter().enumerate() {
            files.put(format!("frames/{frame}.ply"), bytes);
        }
        check(Scene::load(&files.path("frames")).map(|scene| scene.subject));
    }
}

/// # Panics
/// If an accepted field is invalid, or a refusal is not one line.
fn check(imported: anyhow::Result<Imported>) {
    match imported {
        Ok(imported) => {
            imported.field.check().expect("an accepted field is valid");
            assert!(!imported.field.is_empty());
            let account = imported.account;
            assert!(account.sentences().iter().all(|sentence| !sentence.contains('\n')), "{account:?}");
            let hints = imported.hints;
            let numbers = [hints.metres_per_unit, hints.duration_s, hints.fps];
            assert!(numbers.into_iter().flatten().all(|x| x.is_finite() && x > 0.0), "{numbers:?}");
        }
        Err(error) => check_refusal(&error),
    }
}
