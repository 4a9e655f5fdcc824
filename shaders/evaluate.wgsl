// Stage evaluate: a Gaussian at the instant `t`. The paper's trajectory and temporal opacity, and
// the linear rotation of Spacetime Gaussians.

// Per moving Gaussian MOTION_WORDS words: the window centre tau (f32), then 16-bit floats, two to
// a word: 1/s, the MOTION_ORDER motion coefficients, and the rate of rotation if it ROTATES.
@group(1) @binding(3) var<storage, read> motion: array<u32>;

fn evaluate(index: u32, t: f32) -> Instant {
    var instant = at_rest(gaussians[index]);
    if index < ranges.first_moving {
        return instant;
    }
    let record = (index - ranges.first_moving) * MOTION_WORDS;
    let d = t - bitcast<f32>(motion[record]);

    // o exp(-d^2 / (2 s^2))
    let z = d * half_at(record, 0u);
    instant.opacity *= exp(-0.5 * z * z);

    // mu + v1 d + v2 d^2 + v3 d^3
    var offset = vec3<f32>(0.0);
    for (var power = MOTION_ORDER; power > 0u; power--) {
        let first = 3u * power - 2u;
        let v = vec3<f32>(half_at(record, first), half_at(record, first + 1u), half_at(record, first + 2u));
        offset = (offset + v * ranges.motion_units[power - 1u]) * d;
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
        let q = instant.rotation + rate * (ranges.rate_unit * d);
        let norm = length(q);
        // A rate can pass exactly through zero; any fixed rotation will do at that instant.
        instant.rotation = select(vec4<f32>(1.0, 0.0, 0.0, 0.0), q / norm, norm > 1e-6);
    }
    return instant;
}

fn half_at(record: u32, i: u32) -> f32 {
    let pair = unpack2x16float(motion[record + 1u + i / 2u]);
    return select(pair.x, pair.y, i % 2u == 1u);
}
