// Colour, degrees 1 to SH_DEGREE: real spherical harmonics in the basis order and signs of 3D Gaussian
// Splatting.
//
// Inputs: a Gaussian's record, its coefficients and the direction from the eye. Output: its display-referred
// colour.

// SH_WORDS words per Gaussian: the largest absolute coefficient (f32), then one word per coefficient with red
// and green in 11 bits and blue in 10, as fractions of the largest.
@group(1) @binding(4) var<storage, read> sh: array<u32>;

// Colour towards the eye; `direction` is the unit vector from the eye to the Gaussian.
fn color_of(index: u32, direction: vec3<f32>) -> vec3<f32> {
    let record = index * SH_WORDS;
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    var sum = 0.48860251 * (z * sh_at(record, 2u) - y * sh_at(record, 1u) - x * sh_at(record, 3u));
    if SH_DEGREE >= 2u {
        let xx = x * x;
        let yy = y * y;
        let zz = z * z;
        sum += 1.09254843 * (x * y * sh_at(record, 4u) - y * z * sh_at(record, 5u) - x * z * sh_at(record, 7u));
        sum += 0.31539157 * (2.0 * zz - xx - yy) * sh_at(record, 6u);
        sum += 0.54627422 * (xx - yy) * sh_at(record, 8u);
        if SH_DEGREE >= 3u {
            sum -= 0.59004359 * y * (3.0 * xx - yy) * sh_at(record, 9u);
            sum += 2.89061144 * x * y * z * sh_at(record, 10u);
            sum -= 0.45704580 * y * (4.0 * zz - xx - yy) * sh_at(record, 11u);
            sum += 0.37317633 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * sh_at(record, 12u);
            sum -= 0.45704580 * x * (4.0 * zz - xx - yy) * sh_at(record, 13u);
            sum += 1.44530572 * z * (xx - yy) * sh_at(record, 14u);
            sum -= 0.59004359 * x * (xx - 3.0 * yy) * sh_at(record, 15u);
        }
    }
    return base_color(gaussians[index]) + sum * bitcast<f32>(sh[record]);
}

// Coefficient `k`, 1 to (SH_DEGREE + 1)^2 - 1, as a fraction of the largest.
fn sh_at(record: u32, k: u32) -> vec3<f32> {
    let bits = bitcast<i32>(sh[record + k]);
    let rgb = vec3<i32>(extractBits(bits, 0u, 11u), extractBits(bits, 11u, 11u), extractBits(bits, 22u, 10u));
    return vec3<f32>(rgb) / vec3<f32>(1023.0, 1023.0, 511.0);
}
