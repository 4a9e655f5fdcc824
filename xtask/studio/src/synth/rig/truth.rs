//! Everything that perturbs a rig, as `truth.json`. `xtask/CAPTURE.md` describes its keys.

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
