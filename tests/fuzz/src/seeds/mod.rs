//! The initial corpus: a small input of every kind.

mod captures;
mod fields;

use codec::{ClipInfo, Field, Temporal, Viewpoint};

pub use captures::captures;
pub(crate) use captures::{easyvolcap, manifest, photograph};
pub use fields::fields;
pub(crate) use fields::{one_gaussian, sog_files};

use crate::kinds::scene;

/// An input and its name.
pub type Seed = (String, Vec<u8>);

/// Four Gaussians with this motion order; above 0 they also rotate.
pub(crate) fn field(motion_order: u8) -> Field {
    let n = 4;
    let order = usize::from(motion_order);
    Field {
        centers: (0..n).map(|i| [i as f32, 0.5, -0.25 * i as f32]).collect(),
        rotations: vec![[0.5, -0.5, 0.5, 0.5]; n],
        log_scales: vec![[-3.0, -3.5, -4.0]; n],
        opacities: vec![0.25, 0.5, 0.75, 1.0],
        sh_degree: 0,
        sh: vec![[0.1, 0.2, 0.3]; n],
        temporal: Some(Temporal {
            tau: vec![0.5; n],
            s: vec![0.125, 0.25, 0.5, f32::INFINITY],
            motion_order,
            motion: (0..n * order).map(|k| [0.1, 0.01 * k as f32, 0.0]).collect(),
            rotation_rates: (order > 0).then(|| vec![[0.0, 0.1, 0.0, 0.0]; n]),
        }),
        ..Field::default()
    }
}

/// The description of [`field`].
pub(crate) fn info() -> ClipInfo {
    let front = Viewpoint { name: "front".into(), position: [0.0, 0.0, -5.0], target: [0.0; 3], fov_y: 0.8 };
    ClipInfo {
        duration_s: 1.5,
        fps: 30.0,
        up: [0.0, -1.0, 0.0],
        metres_per_unit: 0.5,
        viewpoints: vec![front],
    }
}

/// Inputs of the target `scene`.
pub fn scenes() -> Vec<Seed> {
    let overrides = r#"{"duration_s": 2.5, "fps": 30, "up": [0, 1, 0], "metres_per_unit": 0.5,
        "viewpoints": [{"name": "front", "position": [0, 0, -3], "target": [0, 0, 0], "fov_y_deg": 50}]}"#;
    let camera = r#"{"width": 64, "height": 48, "K": [[50, 0, 32], [0, 50, 24], [0, 0, 1]],
        "world_to_camera": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]}"#;
    vec![
        seed("overrides", scene::OVERRIDES, overrides.as_bytes()),
        seed("empty", scene::OVERRIDES, b"{}"),
        seed("camera", scene::CAMERA, camera.as_bytes()),
    ]
}

/// Inputs of the target `net`: servers of every kind; the honest ones send the file in parts.
pub fn dialogues() -> Vec<Seed> {
    let half = [0x22, 0x00, 0x02, 0x08];
    let complete = [0x28, 0x08];
    let arbitrary =
        [0x20, 0x04, 0, 0x1f, 1, 1, 0, 0, 0, 0, 1, 0, 2, 0, 1, 5, 40, 41, 42, 43, 44, 0, 0, 0, 3, 9, 9, 9, 1];
    (0..32)
        .map(|flags: u8| {
            let rest =
                if flags & 1 == 0 { [&half[..], &half, &complete].concat() } else { arbitrary.repeat(2) };
            seed(&format!("server-{flags:02}"), flags, &rest)
        })
        .collect()
}

/// An input of a kind.
fn seed(name: &str, kind: u8, bytes: &[u8]) -> Seed {
    (name.to_owned(), [&[kind][..], bytes].concat())
}
