// Stage splat, vertices: projects a Gaussian to a quad along the axes of its footprint, as large as the region
// where its alpha is at least ALPHA_MIN at the instant.
//
// Inputs: the draw order, the evaluated Gaussian and the view. Output: a corner of the quad in clip space, its
// offset from the centre in standard deviations, and the values carried to the fragments.
//
// The footprint is the affine approximation of EWA splatting in the form of gsplat: the Jacobian of the
// projection is taken at the centre, clamped to a margin around the image.

// Rows to draw, back to front.
@group(1) @binding(2) var<storage, read> order: array<u32>;

struct Splat {
    @builtin(position) position: vec4<f32>,
    // Offset from the centre in standard deviations.
    @location(0) local: vec2<f32>,
    // Values for the fragments, see `carried`.
    @location(1) @interpolate(flat, either) carried: vec2<u32>,
}

// Upper limit of a footprint's standard deviations in pixels. Larger footprints are shrunk towards the centre of
// the image, since squares of variances must not overflow, and clipping loses 1e-7 of the distance to the
// corners. An image of 2000 pixels then spans a five-hundredth of a standard deviation instead of none.
const SIGMA_MAX: f32 = 1e6;

// Corner `corner` (bit 0: along the major axis, bit 1: along the minor) of the quad at `place` in the order.
fn splat(corner: u32, place: u32, eye: u32) -> Splat {
    // Outside the clip volume: a quad with all corners here draws nothing.
    let nothing = Splat(vec4<f32>(0.0, 0.0, 2.0, 1.0), vec2<f32>(0.0), vec2<u32>(0u));

    // Conditions are phrased so that NaN fails them.
    let row = order[place];
    let g = evaluate(row);
    if !(g.opacity >= ALPHA_MIN) {
        return nothing;
    }
    // Subtract before rotating: the difference of close numbers is exact.
    let from_eye = g.center - views[eye].eye;
    let center = views[eye].view_from_world * from_eye;
    let faded_opacity = g.opacity * near_fade(center.z, frame.near);
    if !(faded_opacity >= ALPHA_MIN) {
        return nothing;
    }
    let focal = views[eye].focal / center.z;
    var pixel = focal * center.xy + views[eye].principal;

    // The images of the Gaussian's axes are the columns of a 2x3 matrix with rows x and y; the
    // covariance is that matrix times its transpose, plus the filter.
    let axes = views[eye].view_from_world * rotation_matrix(g.rotation);
    let across = transpose(mat3x3<f32>(axes[0] * g.scale.x, axes[1] * g.scale.y, axes[2] * g.scale.z));
    let slope = clamp(center.xy / center.z, views[eye].slope_min, views[eye].slope_max);
    var x = focal.x * (across[0] - slope.x * across[2]);
    var y = focal.y * (across[1] - slope.y * across[2]);
    let extent = max(abs(x), abs(y));
    let largest = max(extent.x, max(extent.y, extent.z));
    if largest > SIGMA_MAX {
        // The centre of the image keeps its offset in standard deviations.
        let shrink = SIGMA_MAX / largest;
        x *= shrink;
        y *= shrink;
        pixel = mix(0.5 * views[eye].size, pixel, shrink);
    }
    // Beyond the support of any footprint, or NaN.
    if !(max(abs(pixel.x), abs(pixel.y)) < 8.0 * SIGMA_MAX) {
        return nothing;
    }
    let xx = dot(x, x) + FILTER;
    let xy = dot(x, y);
    let yy = dot(y, y) + FILTER;

    // Eigenvalues. The determinant comes from the cross product: xx yy - xy^2 would lose the width
    // of a needle to cancellation.
    let half_difference = 0.5 * (xx - yy);
    let spread = length(vec2<f32>(half_difference, xy));
    let major = 0.5 * (xx + yy) + spread;
    let area = length(cross(x, y));
    let minor = (area / major) * area + FILTER * (xx + yy - FILTER) / major;
    let sigma = sqrt(vec2<f32>(major, minor));
    if !(sigma.x < 4.0 * SIGMA_MAX && sigma.y > 0.0) {
        return nothing;
    }
    let opacity = filtered_opacity(faded_opacity, area, xx + yy - 2.0 * FILTER, sigma, views[eye].blur);
    if !(opacity >= ALPHA_MIN) {
        return nothing;
    }
    // Eigenvector of the larger eigenvalue, in the form that does not cancel.
    var axis = vec2<f32>(half_difference + spread, xy);
    if half_difference < 0.0 {
        axis = vec2<f32>(xy, spread - half_difference);
    }
    axis = select(vec2<f32>(1.0, 0.0), normalize(axis), spread > 1e-6 * major);

    // No side needs to extend beyond the farthest corner of the image; the factor covers rounding.
    // At the threshold, the logarithm may be rounded below 0.
    let exact = sqrt(max(0.0, 2.0 * log(opacity / ALPHA_MIN)));
    let farthest = 1.0001 * length(max(abs(pixel), abs(views[eye].size - pixel)));
    let radius = min(vec2<f32>(min(exact, frame.radius_max)), farthest / sigma);
    let local = radius * vec2<f32>(f32(corner & 1u) * 2.0 - 1.0, f32(corner >> 1u) * 2.0 - 1.0);
    let offset = local * sigma;
    let image = pixel + offset.x * axis + offset.y * vec2<f32>(-axis.y, axis.x);
    let ndc = (2.0 * image / views[eye].size - 1.0) * vec2<f32>(1.0, -1.0);

    let color = color_of(row, normalize(from_eye));
    return Splat(vec4<f32>(ndc, 0.0, 1.0), local, carried(place, color, opacity));
}
