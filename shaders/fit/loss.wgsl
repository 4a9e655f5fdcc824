// Stage loss: 0.8 L1 + 0.2 (1 - SSIM), means over all pixels and three channels (the paper's Eq. 9 without
// LPIPS), and its gradient with respect to the image. L1 also compares alpha with the mask, or with 1.
//
// The window of SSIM (Wang et al. 2004) is separable, with zeros beyond the edges. One thread per pixel:
//
// blur_rows: moments, blurred along rows. compare: blurs them across rows; similarity and its derivatives.
// blur_derivatives: derivatives, blurred along rows. loss_backward: blurs them across rows; the gradient.
// sum_loss: the sums for the loss, one group.
//
// In: image, photograph. In and out: d_image, to which the gradient is added. Out: sums in the totals.

@group(0) @binding(3) var<storage, read_write> totals: array<u32>;
// Red, green, blue over black, and alpha.
@group(0) @binding(14) var<storage, read> image: array<vec4<f32>>;
// One byte each: red (lowest), green, blue, and 0 for an invalid pixel, 1 outside of the subject, else the mask.
// Invalid pixels count as equal and have no gradient.
@group(0) @binding(15) var<storage, read> photograph: array<u32>;
// Blurred along rows, `[quantity][channel][pixel]`: first the MOMENTS, then the DERIVATIVES.
@group(0) @binding(16) var<storage, read_write> blurred: array<f32>;
// `[derivative][channel][pixel]`: with respect to the mean of the image, its mean square, the mean product.
@group(0) @binding(17) var<storage, read_write> derivatives: array<f32>;
// Per pixel, summed over the channels: absolute difference, with the difference of alpha; similarity.
@group(0) @binding(18) var<storage, read_write> differences: array<vec2<f32>>;
@group(0) @binding(19) var<storage, read_write> d_image: array<vec4<f32>>;

// Mean of the image and of the photograph, mean of their squares, mean product.
const MOMENTS: u32 = 5u;
const DERIVATIVES: u32 = 3u;
const HALF: i32 = 5;
const C1: f32 = 0.0001;
const C2: f32 = 0.0009;

var<workgroup> parts: array<vec2<f32>, SCAN_GROUP>;

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

// Colour of the image; the photograph's colour for an invalid pixel.
fn image_color(pixel: u32) -> vec3<f32> {
    if is_valid(pixel) {
        return image[pixel].xyz;
    }
    return target_color(pixel);
}

fn pixels() -> u32 {
    return uniforms.size.x * uniforms.size.y;
}

fn slot(quantity: u32, channel: u32, pixel: u32) -> u32 {
    return (3u * quantity + channel) * pixels() + pixel;
}

// First and last offset of the window about `at`, clipped to an axis of `size` pixels.
fn window(at: u32, size: u32) -> vec2<i32> {
    return vec2<i32>(max(-HALF, -i32(at)), min(HALF, i32(size) - 1 - i32(at)));
}

// A quantity in `blurred`, blurred across rows.
fn blurred_across(quantity: u32, channel: u32, pixel: u32) -> f32 {
    let range = window(pixel / uniforms.size.x, uniforms.size.y);
    var sum = 0.0;
    for (var offset = range.x; offset <= range.y; offset++) {
        let other = u32(i32(pixel) + offset * i32(uniforms.size.x));
        sum += WINDOW[offset + HALF] * blurred[slot(quantity, channel, other)];
    }
    return sum;
}

@compute @workgroup_size(GROUP)
fn blur_rows(at: Invocation) {
    let pixel = thread(at);
    if pixel >= pixels() {
        return;
    }
    var moments: array<vec3<f32>, 5>;
    let range = window(pixel % uniforms.size.x, uniforms.size.x);
    for (var offset = range.x; offset <= range.y; offset++) {
        let weight = WINDOW[offset + HALF];
        let other = u32(i32(pixel) + offset);
        let a = image_color(other);
        let b = target_color(other);
        moments[0] += weight * a;
        moments[1] += weight * b;
        moments[2] += weight * (a * a);
        moments[3] += weight * (b * b);
        moments[4] += weight * (a * b);
    }
    for (var i = 0u; i < MOMENTS; i++) {
        for (var channel = 0u; channel < 3u; channel++) {
            blurred[slot(i, channel, pixel)] = moments[i][channel];
        }
    }
}

// Similarity of two windows; leaves its derivatives.
fn similarity_at(channel: u32, pixel: u32) -> f32 {
    var moments: array<f32, 5>;
    for (var i = 0u; i < MOMENTS; i++) {
        moments[i] = blurred_across(i, channel, pixel);
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

@compute @workgroup_size(GROUP)
fn compare(at: Invocation) {
    let pixel = thread(at);
    if pixel >= pixels() {
        return;
    }
    var similarities = 0.0;
    for (var channel = 0u; channel < 3u; channel++) {
        similarities += similarity_at(channel, pixel);
    }
    let difference = abs(image_color(pixel) - target_color(pixel));
    let absolute = difference.x + difference.y + difference.z + abs(alpha_difference(pixel));
    differences[pixel] = vec2<f32>(absolute, similarities);
}

@compute @workgroup_size(GROUP)
fn blur_derivatives(at: Invocation) {
    let pixel = thread(at);
    if pixel >= pixels() {
        return;
    }
    let range = window(pixel % uniforms.size.x, uniforms.size.x);
    for (var i = 0u; i < 3u * DERIVATIVES; i++) {
        var sum = 0.0;
        for (var offset = range.x; offset <= range.y; offset++) {
            sum += WINDOW[offset + HALF] * derivatives[i * pixels() + u32(i32(pixel) + offset)];
        }
        blurred[i * pixels() + pixel] = sum;
    }
}

@compute @workgroup_size(GROUP)
fn loss_backward(at: Invocation) {
    let pixel = thread(at);
    if pixel >= pixels() {
        return;
    }
    if !is_valid(pixel) {
        d_image[pixel] = vec4<f32>(0.0);
        return;
    }
    var by: array<vec3<f32>, 3>;
    for (var i = 0u; i < DERIVATIVES; i++) {
        for (var channel = 0u; channel < 3u; channel++) {
            by[i][channel] = blurred_across(i, channel, pixel);
        }
    }
    let a = image_color(pixel);
    let b = target_color(pixel);
    let each = 1.0 / f32(3u * pixels());
    let by_structure = each * (by[0] + 2.0 * a * by[1] + b * by[2]);
    // sign(NaN) is undefined, but the other term is NaN then.
    let gradient = (1.0 - LAMBDA) * each * sign(a - b) - LAMBDA * by_structure;
    let by_alpha = (1.0 - LAMBDA) * each * uniforms.alpha_channels * sign(alpha_difference(pixel));
    d_image[pixel] += vec4<f32>(gradient, by_alpha);
}

// Leaves the sums over all pixels in the totals, as bits of floats.
@compute @workgroup_size(SCAN_GROUP)
fn sum_loss(@builtin(local_invocation_index) local: u32) {
    var sum = vec2<f32>(0.0);
    for (var pixel = local; pixel < pixels(); pixel += SCAN_GROUP) {
        sum += differences[pixel];
    }
    parts[local] = sum;
    for (var stride = SCAN_GROUP / 2u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if local < stride {
            parts[local] += parts[local + stride];
        }
    }
    if local == 0u {
        totals[ABSOLUTE] = bitcast<u32>(parts[0].x);
        totals[SIMILARITY] = bitcast<u32>(parts[0].y);
    }
}
