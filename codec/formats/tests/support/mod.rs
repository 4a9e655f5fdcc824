//! What the format tests share: made-up fields, files from bytes, the real data.
#![allow(dead_code, reason = "each test binary uses its own part")]

use std::path::{Path, PathBuf};

use codec::{ClipInfo, Field, Temporal, Viewpoint, sh_coefficients};
use formats::{ImportError, Imported, import};

/// Imports a file of this name with this content.
pub(crate) fn import_bytes(name: &str, bytes: &[u8]) -> Result<Imported, ImportError> {
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a temporary folder");
    }
    FOLDER.with(|folder| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a temporary file");
        import(&path)
    })
}

/// The message of an import that must fail for its data.
pub(crate) fn import_error(name: &str, bytes: &[u8]) -> String {
    let error = import_bytes(name, bytes).expect_err("the file is bad").to_string();
    assert!(!error.contains('\n'), "one line: {error}");
    error
}

/// A file of the real data that lies beside the repository, if it is there.
pub(crate) fn data(path: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(path);
    if !path.exists() {
        println!("skipped: no {}", path.display());
    }
    path.exists().then_some(path)
}

/// Names of the columns of 3D Gaussian Splatting without view-dependent colour.
pub(crate) const STATIC: &str =
    "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";

/// An ASCII PLY with one element, `vertex`.
pub(crate) fn ascii_ply(properties: &str, rows: &[&str]) -> Vec<u8> {
    let properties: String = properties.split(' ').map(|name| format!("property float {name}\n")).collect();
    let (count, rows) = (rows.len(), rows.join("\n"));
    format!("ply\nformat ascii 1.0\nelement vertex {count}\n{properties}end_header\n{rows}\n").into_bytes()
}

/// Numbers that look random and are the same every time (a 64-bit linear congruential generator).
pub(crate) struct Noise(pub(crate) u64);

impl Noise {
    pub(crate) fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 32) as u32
    }

    /// Uniform in `[low, high)`.
    pub(crate) fn uniform(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.bits() >> 8) as f32 / (1u32 << 24) as f32
    }

    pub(crate) fn vector<const N: usize>(&mut self, low: f32, high: f32) -> [f32; N] {
        std::array::from_fn(|_| self.uniform(low, high))
    }

    pub(crate) fn rotation(&mut self) -> [f32; 4] {
        let q = self.vector::<4>(-1.0, 1.0);
        let norm = q.iter().map(|x| x * x).sum::<f32>().sqrt();
        q.map(|x| x / norm)
    }
}

/// A made-up field in normal form. `motion_order`: none for a static one.
pub(crate) fn field(len: usize, sh_degree: u8, motion_order: Option<u8>, turns: bool) -> Field {
    let mut noise = Noise(len as u64 + 31 * u64::from(sh_degree));
    let field = Field {
        centers: (0..len).map(|_| noise.vector(-3.0, 3.0)).collect(),
        rotations: (0..len).map(|_| noise.rotation()).collect(),
        log_scales: (0..len).map(|_| noise.vector(-7.0, 0.5)).collect(),
        opacities: (0..len).map(|_| noise.uniform(0.0, 1.0)).collect(),
        sh_degree,
        sh: (0..len * sh_coefficients(sh_degree)).map(|_| noise.vector(-0.9, 0.9)).collect(),
        temporal: motion_order.map(|motion_order| Temporal {
            tau: (0..len).map(|_| noise.uniform(-0.2, 1.2)).collect(),
            s: (0..len).map(|i| if i % 5 == 4 { f32::INFINITY } else { noise.uniform(0.01, 0.6) }).collect(),
            motion_order,
            motion: (0..len * usize::from(motion_order)).map(|_| noise.vector(-1.0, 1.0)).collect(),
            rotation_rates: turns.then(|| (0..len).map(|_| noise.vector(-0.5, 0.5)).collect()),
        }),
        ..Field::default()
    };
    field.check().expect("a valid field");
    field
}

/// Metadata unlike any default.
pub(crate) fn info() -> ClipInfo {
    ClipInfo {
        duration_s: 1.6333333,
        fps: 29.97,
        up: [0.0, 0.6, -0.8],
        metres_per_unit: 0.37,
        viewpoints: vec![
            Viewpoint {
                name: "front row".into(),
                position: [0.1, 1.7, -3.3],
                target: [0.0, 0.85, 0.0],
                fov_y: 0.9,
            },
            Viewpoint { name: "Übersicht".into(), position: [1e-7, 4.0, 0.3], target: [0.0; 3], fov_y: 1.1 },
        ],
    }
}

/// Asserts that every pair of numbers is at most `tolerance` apart.
#[track_caller]
pub(crate) fn assert_close<'n>(
    what: &str,
    actual: impl IntoIterator<Item = &'n f32>,
    expected: impl IntoIterator<Item = &'n f32>,
    tolerance: impl Fn(f32) -> f32,
) {
    let (actual, expected): (Vec<_>, Vec<_>) = (actual.into_iter().collect(), expected.into_iter().collect());
    assert_eq!(actual.len(), expected.len(), "{what}: length");
    for (i, (a, e)) in actual.into_iter().zip(expected).enumerate() {
        assert!(a == e || (a - e).abs() <= tolerance(*e), "{what}, number {i}: {a}, {e} expected");
    }
}

/// Asserts that quaternions are the same rotations, each component within `tolerance`.
#[track_caller]
pub(crate) fn assert_same_rotations(actual: &[[f32; 4]], expected: &[[f32; 4]], tolerance: f32) {
    assert_eq!(actual.len(), expected.len());
    for (a, e) in actual.iter().zip(expected) {
        let dot: f32 = a.iter().zip(e).map(|(x, y)| x * y).sum();
        let e = e.map(|x| x * dot.signum());
        assert_close("rotation", a, &e, |_| tolerance);
    }
}
