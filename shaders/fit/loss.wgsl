// Stage loss: 0.8 L1 + 0.2 (1 - SSIM), means over all pixels and three channels (the paper's Eq. 9 without
// LPIPS), and its gradient with respect to the image. L1 also compares alpha with the mask, or with 1. The image is compared as
// the camera shows it.
//
// The window of SSIM (Wang et al. 2004) is separable, with zeros beyond the edges. One group per tile, one thread per
// pixel; a channel at a time, the group blurs what its windows cover along rows, then along columns. compare: the moments;
// leaves the derivatives of the similarity. loss_backward: these; the gradient.
//
// In: image, photograph. In and out: d_image, to which the gradient is added if it has the gradient of another term. Out: sums
// over the pixels of each tile, in `tile_sums`.

@group(0) @binding(14) var<storage, read> image: array<vec4<f32>>;
// One byte each: red (lowest), green, blue, and 0 for an invalid pixel, 1 outside of the subject, else the mask.
// Invalid pixels count as equal and have no gradient.
@group(0) @binding(15) var<storage, read> photograph: array<u32>;
// By tile: absolute difference, with the difference of alpha, and similarity, over the channels; the gradient with respect to
// the response.
@group(0) @binding(16) var<storage, read_write> tile_sums: array<f32>;
// `[derivative][channel][pixel]`: with respect to the mean of the image, its mean square, the mean product.
@group(0) @binding(17) var<storage, read_write> derivatives: array<f32>;
@group(0) @binding(19) var<storage, read_write> d_image: array<vec4<f32>>;

// Mean of the image and of the photograph, mean of their squares, mean product.
const MOMENTS: u32 = 5u;
const DERIVATIVES: u32 = 3u;
const HALF: u32 = 5u;
const TAPS: u32 = 2u * HALF + 1u;
const C1: f32 = 0.0001;
const C2: f32 = 0.0009;

const PIXELS: u32 = TILE * TILE;
// What the windows of a tile cover along an axis, and in all; the same blurred along rows.
const COVERED: u32 = TILE + 2u * HALF;
const INPUTS: u32 = COVERED * COVERED;
const ROWS: u32 = COVERED * TILE;

// Inputs of the windows, one quantity after the other, and behind them these blurred along rows; then numbers to be summed.
var<workgroup> scratch: array<f32, 2u * INPUTS + MOMENTS * ROWS>;

struct Place {
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
}

// A pixel of the tile; it may be outside the image.
fn pixel_of(at: Place) -> vec2<u32> {
    return at.tile.xy * TILE + vec2<u32>(at.local % TILE, at.local / TILE);
}

fn is_inside(pixel: vec2<u32>) -> bool {
    return all(pixel < uniforms.size);
}

fn index_of(pixel: vec2<u32>) -> u32 {
    return pixel.y * uniforms.size.x + pixel.x;
}

// The pixel of number `k` of those that the windows of a tile cover; outside of the image for what is beyond an edge.
fn covered(tile: vec2<u32>, k: u32) -> vec2<u32> {
    return tile * TILE + vec2<u32>(k % COVERED, k / COVERED) - HALF;
}

fn is_valid(pixel: u32) -> bool {
    return (photograph[pixel] >> 24u) != 0u;
}

fn target_color(pixel: u32) -> vec3<f32> {
    let bytes = photograph[pixel];
    return vec3<f32>(vec3<u32>(bytes & 0xffu, (bytes >> 8u) & 0xffu, (bytes >> 16u) & 0xffu)) / 255.0;
}

// Alpha of the image minus the mask, weighted; 0 for an invalid pixel.
fn alpha_difference(pixel: u32) -> f32 {
    let mask = photograph[pixel] >> 24u;
    if mask == 0u {
        return 0.0;
    }
    let opacity = select(f32(mask) / 255.0, 0.0, mask == 1u);
    return uniforms.alpha_channels * (image[pixel].w - opacity);
}

// Colour of the image as the camera shows it; the photograph's colour for an invalid pixel.
fn image_color(pixel: vec2<u32>) -> vec3<f32> {
    let index = index_of(pixel);
    if is_valid(index) {
        return factor_at(pixel) * color_of(image[index]);
    }
    return target_color(index);
}

fn slot(derivative: u32, channel: u32, pixel: u32) -> u32 {
    return (3u * derivative + channel) * uniforms.size.x * uniforms.size.y + pixel;
}

// A quantity that was blurred along rows, blurred along the column of a thread. Quantities begin at `start` in `scratch`.
fn blurred(start: u32, quantity: u32, local: u32) -> f32 {
    var sum = 0.0;
    for (var tap = 0u; tap < TAPS; tap++) {
        sum += WINDOW[tap] * scratch[start + quantity * ROWS + local + tap * TILE];
    }
    return sum;
}

// Leaves the moments of a channel, blurred along rows.
fn blur_moments(at: Place, channel: u32) {
    for (var k = at.local; k < INPUTS; k += PIXELS) {
        let pixel = covered(at.tile.xy, k);
        var both = vec2<f32>(0.0);
        if is_inside(pixel) {
            both = vec2<f32>(image_color(pixel)[channel], target_color(index_of(pixel))[channel]);
        }
        scratch[k] = both.x;
        scratch[INPUTS + k] = both.y;
    }
    workgroupBarrier();
    for (var k = at.local; k < ROWS; k += PIXELS) {
        let first = k / TILE * COVERED + k % TILE;
        var moments: array<f32, MOMENTS>;
        for (var tap = 0u; tap < TAPS; tap++) {
            let weight = WINDOW[tap];
            let a = scratch[first + tap];
            let b = scratch[INPUTS + first + tap];
            moments[0] += weight * a;
            moments[1] += weight * b;
            moments[2] += weight * (a * a);
            moments[3] += weight * (b * b);
            moments[4] += weight * (a * b);
        }
        for (var i = 0u; i < MOMENTS; i++) {
            scratch[2u * INPUTS + i * ROWS + k] = moments[i];
        }
    }
    workgroupBarrier();
}

// Similarity of the windows about a pixel; leaves its derivatives.
fn similarity_at(channel: u32, local: u32, pixel: u32) -> f32 {
    var moments: array<f32, MOMENTS>;
    for (var i = 0u; i < MOMENTS; i++) {
        moments[i] = blurred(2u * INPUTS, i, local);
    }
    let aa = moments[0] * moments[0];
    let bb = moments[1] * moments[1];
    let ab = moments[0] * moments[1];
    let luminance = 2.0 * ab + C1;
    let structure = 2.0 * (moments[4] - ab) + C2;
    let luminances = aa + bb + C1;
    let structures = (moments[2] - aa) + (moments[3] - bb) + C2;
    let scale = 1.0 / (luminances * structures);
    let similarity = luminance * structure * scale;
    derivatives[slot(0u, channel, pixel)] = 2.0 * moments[1] * (structure - luminance) * scale
        - 2.0 * moments[0] * similarity * (1.0 / luminances - 1.0 / structures);
    derivatives[slot(1u, channel, pixel)] = -similarity / structures;
    derivatives[slot(2u, channel, pixel)] = 2.0 * luminance * scale;
    return similarity;
}

// Sums `count` numbers of each thread, `[number][thread]` in `scratch`, into those of the tile from `first` on.
fn sum_tile(at: Place, first: u32, count: u32) {
    workgroupBarrier();
    let all = (at.tile.y * uniforms.tiles.x + at.tile.x) * TILE_NUMBERS;
    // Sums of TILE threads, then the sums of these.
    var sum = 0.0;
    let number = at.local / TILE;
    if number < count {
        for (var k = 0u; k < TILE; k++) {
            sum += scratch[number * PIXELS + k * TILE + at.local % TILE];
        }
    }
    workgroupBarrier();
    scratch[at.local] = sum;
    workgroupBarrier();
    if at.local < count {
        var total = 0.0;
        for (var k = 0u; k < TILE; k++) {
            total += scratch[at.local * TILE + k];
        }
        tile_sums[all + first + at.local] = total;
    }
}

@compute @workgroup_size(PIXELS)
fn compare(at: Place) {
    let pixel = pixel_of(at);
    let index = index_of(pixel);
    var similarities = 0.0;
    for (var channel = 0u; channel < 3u; channel++) {
        blur_moments(at, channel);
        if is_inside(pixel) {
            similarities += similarity_at(channel, at.local, index);
        }
    }
    var absolute = 0.0;
    if is_inside(pixel) {
        let difference = abs(image_color(pixel) - target_color(index));
        absolute = difference.x + difference.y + difference.z + abs(alpha_difference(index));
    }
    scratch[at.local] = absolute;
    scratch[PIXELS + at.local] = similarities;
    sum_tile(at, 0u, 2u);
}

// Leaves the derivatives of a channel, blurred along rows.
fn blur_derivatives(at: Place, channel: u32) {
    for (var i = 0u; i < DERIVATIVES; i++) {
        for (var k = at.local; k < INPUTS; k += PIXELS) {
            let pixel = covered(at.tile.xy, k);
            var derivative = 0.0;
            if is_inside(pixel) {
                derivative = derivatives[slot(i, channel, index_of(pixel))];
            }
            scratch[k] = derivative;
        }
        workgroupBarrier();
        for (var k = at.local; k < ROWS; k += PIXELS) {
            let first = k / TILE * COVERED + k % TILE;
            var sum = 0.0;
            for (var tap = 0u; tap < TAPS; tap++) {
                sum += WINDOW[tap] * scratch[first + tap];
            }
            scratch[INPUTS + i * ROWS + k] = sum;
        }
        workgroupBarrier();
    }
}

// Gradient with respect to what the camera shows of a pixel, given the blurred derivatives.
fn gradient_at(pixel: vec2<u32>, by: array<vec3<f32>, DERIVATIVES>) -> vec4<f32> {
    let index = index_of(pixel);
    if !is_valid(index) {
        return vec4<f32>(0.0);
    }
    let a = image_color(pixel);
    let b = target_color(index);
    let each = 1.0 / f32(3u * uniforms.size.x * uniforms.size.y);
    let by_structure = each * (by[0] + 2.0 * a * by[1] + b * by[2]);
    // sign(NaN) is undefined, but the other term is NaN then.
    let by_color = (1.0 - LAMBDA) * each * sign(a - b) - LAMBDA * by_structure;
    let by_alpha = (1.0 - LAMBDA) * each * uniforms.alpha_channels * sign(alpha_difference(index));
    var gradient = vec4<f32>(by_color, by_alpha);
    if uniforms.adds_gradient != 0u {
        gradient += d_image[index];
    }
    return gradient;
}

@compute @workgroup_size(PIXELS)
fn loss_backward(at: Place) {
    let pixel = pixel_of(at);
    let index = index_of(pixel);
    var by: array<vec3<f32>, DERIVATIVES>;
    for (var channel = 0u; channel < 3u; channel++) {
        blur_derivatives(at, channel);
        for (var i = 0u; i < DERIVATIVES; i++) {
            by[i][channel] = blurred(INPUTS, i, at.local);
        }
        workgroupBarrier();
    }
    var by_color: array<vec4<f32>, 3>;
    var by_vignette = 0.0;
    if is_inside(pixel) {
        let d_seen = gradient_at(pixel, by);
        let d_color = d_seen.xyz * factor_at(pixel);
        by_color[0] = d_color.x * image[index];
        by_color[1] = d_color.y * image[index];
        by_color[2] = d_color.z * image[index];
        by_vignette = dot(d_seen.xyz, color_of(image[index])) * square_of(pixel);
        d_image[index] = vec4<f32>(0.0, 0.0, 0.0, d_seen.w) + color_backward(d_color);
    }
    if uniforms.learns_camera != 0u {
        for (var number = 0u; number < 12u; number++) {
            scratch[number * PIXELS + at.local] = by_color[number / 4u][number % 4u];
        }
        scratch[12u * PIXELS + at.local] = by_vignette;
        sum_tile(at, 2u, RESPONSE_NUMBERS);
    }
}
