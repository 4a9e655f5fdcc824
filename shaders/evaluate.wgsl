// Stage evaluate: evaluates a Gaussian at the instant of the frame, by the paper's trajectory and temporal
// opacity and the linear rotation of Spacetime Gaussians.
//
// Inputs: the Gaussian's record and motion, and the time of the frame. Output: centre, opacity, rotation and
// scale at the instant.
//
// A record is expanded about an instant of its own, the centre of the overlap of its window and the clip, and
// measures time from there in widths of its window. Its numbers are therefore as large as their visible effect
// for any window, and nothing cancels.

// MOTION_WORDS words per dynamic Gaussian: the instant, in 65536ths of the clip, and its distance
// from the window's centre, in 1024ths of a width, in 16 bits each; then 16-bit floats, two to a
// word: 1/s in WIDTH_UNIT, the MOTION_ORDER motion coefficients, and the rate of rotation in
// RATE_UNIT if it ROTATES.
@group(1) @binding(3) var<storage, read> motion: array<u32>;

fn evaluate(index: u32) -> Instant {
    var instant = at_rest(gaussians[index]);
    if index < ranges.first_dynamic {
        return instant;
    }
    let record = (index - ranges.first_dynamic) * MOTION_WORDS;
    let about = motion[record];
    let d = frame.time - f32(about & 0xffffu) / 65536.0 + frame.time_rest;
    let widths = half_at(record, 0u) * WIDTH_UNIT;

    // o exp(-(t - tau)^2 / (2 s^2))
    let z = f32(bitcast<i32>(about) >> 16u) / 1024.0 + d * widths;
    instant.opacity *= exp(-0.5 * z * z);

    // x + w1 u + w2 u^2 + w3 u^3; windows wider than the clip measure time in clips.
    let u = d * max(1.0, widths);
    var offset = vec3<f32>(0.0);
    for (var power = MOTION_ORDER; power > 0u; power--) {
        let first = 3u * power - 2u;
        let w = vec3<f32>(half_at(record, first), half_at(record, first + 1u), half_at(record, first + 2u));
        offset = (offset + w * ranges.motion_units[power - 1u]) * u;
    }
    instant.center += offset;

    if ROTATES {
        let first = 3u * MOTION_ORDER + 1u;
        let rate = vec4<f32>(
            half_at(record, first),
            half_at(record, first + 1u),
            half_at(record, first + 2u),
            half_at(record, first + 3u),
        );
        let q = instant.rotation + rate * (RATE_UNIT * u);
        let norm = length(q);
        // The quaternion can pass through zero; any fixed rotation will do at that instant.
        instant.rotation = select(vec4<f32>(1.0, 0.0, 0.0, 0.0), q / norm, norm > 1e-6);
    }
    return instant;
}

fn half_at(record: u32, i: u32) -> f32 {
    let pair = unpack2x16float(motion[record + 1u + i / 2u]);
    return select(pair.x, pair.y, i % 2u == 1u);
}
