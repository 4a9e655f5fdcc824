//! Everything that perturbs a rig, as `truth.json`: `settings`; `sound` with its `place`, `clap_s` and `speed_m_s`; and
//! for each of `cameras`
//!
//! | key | meaning |
//! |---|---|
//! | `id`, `w`, `h`, `K`, `w2c` | as in a manifest, upright |
//! | `start_s` | second of the first frame; all cameras run from second 0 on |
//! | `times_s` | second of each frame: `start_s` + its presentation time (1 + `drift_ppm` / 10^6) |
//! | `gain`, `white_balance` | the factor of green; the factors of red, green and blue relative to it |
//! | `noise` | in 255ths |
//! | `rotated_degrees` | 90 if players turn the stored picture by so much, clockwise |
//! | `sound_delay_s` | seconds that sound takes from `place` to the camera, at 343 m/s |
//! | `sound_skew_s`, `sound_noise_db` | seconds that sound is late in the file; null without noise |
//!
//! What sounds at second t is in a camera's file at (t + `sound_delay_s` - `start_s`) / (1 + `drift_ppm` / 10^6) +
//! `sound_skew_s`: there is a clap at `clap_s`, and noise in syllables, from 300 to 4,800 Hz.

use serde_json::{Value, json};

use super::sound::{CLAP_S, SPEED_M_S};
use super::timing::Timing;
use super::view::Rig;
use crate::synth::stage::name;

/// Name of the file.
pub(super) const FILE: &str = "truth.json";

/// The file.
pub(super) fn truth(rig: &Rig) -> String {
    let truth = json!({
        "settings": rig.settings,
        "sound": { "place": rig.sound.place, "clap_s": CLAP_S, "speed_m_s": SPEED_M_S },
        "cameras": (0..rig.cameras.len()).map(|camera| of_camera(rig, camera)).collect::<Vec<Value>>(),
    });
    format!("{truth:#}\n")
}

fn of_camera(rig: &Rig, number: usize) -> Value {
    let (camera, errors) = (&rig.cameras[number], &rig.errors[number]);
    let [red, green, blue] = errors.gains;
    json!({
        "id": name(number),
        "w": camera.width,
        "h": camera.height,
        "K": camera.k,
        "w2c": camera.camera_from_world,
        "start_s": errors.start_s,
        "drift_ppm": errors.drift_ppm,
        "variable_rate": matches!(errors.timing, Timing::Variable { .. }),
        "times_s": (0..errors.frames).map(|frame| errors.frame_time_s(frame)).collect::<Vec<f64>>(),
        "gain": green,
        "white_balance": [red / green, 1.0, blue / green],
        "noise": errors.noise,
        "rotated_degrees": if errors.is_rotated { 90 } else { 0 },
        "sound_skew_s": errors.sound_skew_s,
        "sound_delay_s": rig.sound.delay_s(camera.position()),
        "sound_noise_db": rig.settings.perturbations.sound_noise_db,
    })
}
