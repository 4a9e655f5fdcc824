// Spherical harmonics to degree 3 and their derivatives, in the basis order and signs of 3D Gaussian
// Splatting.

// Normalisation constants, named by degree and order: sqrt(x / pi).
const N00: f32 = 0.28209479177387814; // x = 1/4
const N1: f32 = 0.4886025119029199; // 3/4
const N20: f32 = 0.31539156525252005; // 5/16
const N21: f32 = 1.0925484305920792; // 15/4
const N22: f32 = 0.5462742152960396; // 15/16
const N30: f32 = 0.3731763325901154; // 7/16
const N31: f32 = 0.4570457994644658; // 21/32
const N32: f32 = 1.445305721320277; // 105/16
const N33: f32 = 0.5900435899266435; // 35/32

// Values of the first HARMONICS harmonics (1, 4, 9 or 16) at a unit vector; 0 for the others.
fn harmonics(direction: vec3<f32>) -> array<f32, 16> {
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    var values = array<f32, 16>();
    values[0] = N00;
    if HARMONICS > 1u {
        values[1] = -N1 * y;
        values[2] = N1 * z;
        values[3] = -N1 * x;
    }
    if HARMONICS > 4u {
        values[4] = N21 * x * y;
        values[5] = -N21 * y * z;
        values[6] = N20 * (2.0 * zz - xx - yy);
        values[7] = -N21 * x * z;
        values[8] = N22 * (xx - yy);
    }
    if HARMONICS > 9u {
        values[9] = -N33 * y * (3.0 * xx - yy);
        values[10] = 2.0 * N32 * x * y * z;
        values[11] = -N31 * y * (4.0 * zz - xx - yy);
        values[12] = N30 * z * (2.0 * zz - 3.0 * (xx + yy));
        values[13] = -N31 * x * (4.0 * zz - xx - yy);
        values[14] = N32 * z * (xx - yy);
        values[15] = -N33 * x * (xx - 3.0 * yy);
    }
    return values;
}

// Gradient with respect to the direction of the sum of `w[k]` times harmonic `k`, as the polynomials above.
fn harmonics_backward(direction: vec3<f32>, w: array<f32, 16>) -> vec3<f32> {
    let x = direction.x;
    let y = direction.y;
    let z = direction.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    var d = vec3<f32>(0.0);
    if HARMONICS > 1u {
        d += N1 * vec3<f32>(-w[3], -w[1], w[2]);
    }
    if HARMONICS > 4u {
        d.x += N21 * (y * w[4] - z * w[7]) + 2.0 * x * (N22 * w[8] - N20 * w[6]);
        d.y += N21 * (x * w[4] - z * w[5]) - 2.0 * y * (N22 * w[8] + N20 * w[6]);
        d.z += 4.0 * N20 * z * w[6] - N21 * (y * w[5] + x * w[7]);
    }
    if HARMONICS > 9u {
        d.x += 2.0 * N32 * (y * z * w[10] + x * z * w[14])
            + N31 * (2.0 * x * y * w[11] - (4.0 * zz - 3.0 * xx - yy) * w[13])
            - 6.0 * N30 * x * z * w[12]
            - N33 * (6.0 * x * y * w[9] + 3.0 * (xx - yy) * w[15]);
        d.y += 2.0 * N32 * (x * z * w[10] - y * z * w[14])
            + N31 * (2.0 * x * y * w[13] - (4.0 * zz - xx - 3.0 * yy) * w[11])
            - 6.0 * N30 * y * z * w[12]
            - N33 * (3.0 * (xx - yy) * w[9] - 6.0 * x * y * w[15]);
        d.z += N32 * (2.0 * x * y * w[10] + (xx - yy) * w[14])
            - 8.0 * N31 * z * (y * w[11] + x * w[13])
            + N30 * (6.0 * zz - 3.0 * (xx + yy)) * w[12];
    }
    return d;
}
