// The packed record of a Gaussian, and its unpacking (bind group 1).

struct Gaussian {
    // Centre at the record's instant, relative to the clip's origin, in units of the source.
    center: vec3<f32>,
    // Smallest-three quaternion: two components in 15 bits each, the index of the omitted one in 2.
    rotation: u32,
    // The third component in 16 bits, the first log-scale in 16.
    rotation_scale: u32,
    // The other log-scales, 16 bits each, from -LOG_SCALE_MAX in steps of LOG_SCALE_STEP.
    scales: u32,
    // Peak opacity (unorm16), red (f16).
    opacity_red: u32,
    // Green, blue (f16).
    green_blue: u32,
}

// What the packed numbers of a field depend on.
struct Ranges {
    // Factors of the motion coefficients of power 1, 2, 3.
    motion_units: vec3<f32>,
    // First row with temporal data.
    first_dynamic: u32,
}

@group(1) @binding(0) var<uniform> ranges: Ranges;
@group(1) @binding(1) var<storage, read> gaussians: array<Gaussian>;

// A Gaussian at one instant.
struct Instant {
    center: vec3<f32>,
    opacity: f32,
    // Unit quaternion w, x, y, z.
    rotation: vec4<f32>,
    // Standard deviations along its own axes.
    scale: vec3<f32>,
}

fn at_rest(g: Gaussian) -> Instant {
    let scales = vec3<u32>(g.rotation_scale >> 16u, g.scales & 0xffffu, g.scales >> 16u);
    return Instant(
        g.center,
        unpack2x16unorm(g.opacity_red).x,
        unpack_rotation(g.rotation, g.rotation_scale),
        exp(LOG_SCALE_STEP * vec3<f32>(scales) - LOG_SCALE_MAX),
    );
}

// View-independent colour: 0.5 + Y_0 c_0.
fn base_color(g: Gaussian) -> vec3<f32> {
    return vec3<f32>(unpack2x16float(g.opacity_red).y, unpack2x16float(g.green_blue));
}

// Inverse of `pack_rotation`. The omitted component is the largest, and positive.
fn unpack_rotation(first: u32, second: u32) -> vec4<f32> {
    let bits = bitcast<i32>(first);
    let a = f32(extractBits(bits, 0u, 15u)) / 16383.0;
    let b = f32(extractBits(bits, 15u, 15u)) / 16383.0;
    let c = f32(extractBits(bitcast<i32>(second), 0u, 16u)) / 32767.0;
    let small = vec3<f32>(a, b, c) * 0.70710678;
    let large = sqrt(max(0.0, 1.0 - dot(small, small)));
    switch first >> 30u {
        case 0u: { return vec4<f32>(large, small); }
        case 1u: { return vec4<f32>(small.x, large, small.yz); }
        case 2u: { return vec4<f32>(small.xy, large, small.z); }
        default: { return vec4<f32>(small, large); }
    }
}

// The rotation matrix of a unit quaternion w, x, y, z.
fn rotation_matrix(q: vec4<f32>) -> mat3x3<f32> {
    let w = q.x;
    let v = q.yzw;
    let d = v + v;
    let xx = v.x * d.x;
    let yy = v.y * d.y;
    let zz = v.z * d.z;
    let xy = v.x * d.y;
    let xz = v.x * d.z;
    let yz = v.y * d.z;
    let wd = w * d;
    return mat3x3<f32>(
        vec3<f32>(1.0 - yy - zz, xy + wd.z, xz - wd.y),
        vec3<f32>(xy - wd.z, 1.0 - xx - zz, yz + wd.x),
        vec3<f32>(xz + wd.y, yz - wd.x, 1.0 - xx - yy),
    );
}
