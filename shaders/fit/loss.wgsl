// Stage loss: how far a picture is from its photograph (the paper's Eq. 9 without LPIPS), and which way each
// of its pixels should go: 0.8 L1 + 0.2 (1 - SSIM), means over all pixels and three channels.
//
// The window of structural similarity (Wang et al. 2004) is separable: the first kernel blurs along rows what
// the means are made of, the second blurs it across rows and compares, the third and fourth blur the
// derivatives. Zeros lie beyond the edges.

@group(0) @binding(3) var<storage, read_write> state: array<u32>;
// Red, green, blue over black, and alpha.
@group(0) @binding(14) var<storage, read> picture: array<vec4<f32>>;
// Red, green, blue in a byte each, lowest first; the highest byte is 0 where the photograph does not show
// what is there. Such pixels count as equal and carry no gradient.
@group(0) @binding(15) var<storage, read> photograph: array<u32>;
// Blurred along rows: first MEANS per channel and pixel, then DERIVATIVES.
@group(0) @binding(16) var<storage, read_write> blurred: array<f32>;
// By the blurred picture, its blurred square, the blurred product: DERIVATIVES per channel and pixel.
@group(0) @binding(17) var<storage, read_write> derivatives: array<f32>;
// Of each pixel, over the channels: sums of absolute differences and of similarities.
@group(0) @binding(18) var<storage, read_write> differences: array<vec2<f32>>;
// The gradient by the picture; it comes with what is to be added to.
@group(0) @binding(19) var<storage, read_write> d_picture: array<vec4<f32>>;

const MEANS: u32 = 5u;
const DERIVATIVES: u32 = 3u;
const HALF: i32 = 5;
const C1: f32 = 0.0001;
const C2: f32 = 0.0009;

var<workgroup> parts: array<vec2<f32>, SCAN_GROUP>;

fn is_seen(pixel: u32) -> bool {
    return (photograph[pixel] >> 24u) != 0u;
}

fn taken(pixel: u32) -> vec3<f32> {
    let bytes = photograph[pixel];
    return vec3<f32>(vec3<u32>(bytes & 0xffu, (bytes >> 8u) & 0xffu, (bytes >> 16u) & 0xffu)) / 255.0;
}

fn drawn(pixel: u32) -> vec3<f32> {
    if is_seen(pixel) {
        return picture[pixel].xyz;
    }
    return taken(pixel);
}

fn pixels() -> u32 {
    return step.size.x * step.size.y;
}

// A number of a pixel and channel.
fn slot(i: u32, channel: u32, pixel: u32) -> u32 {
    return (3u * i + channel) * pixels() + pixel;
}

// The offsets from -HALF on at which a window about `at` lies within `size`.
fn window(at: u32, size: u32) -> vec2<i32> {
    return vec2<i32>(max(-HALF, -i32(at)), min(HALF, i32(size) - 1 - i32(at)));
}

@compute @workgroup_size(GROUP)
fn blur_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = thread(group, groups, local);
    if pixel >= pixels() {
        return;
    }
    var means: array<vec3<f32>, 5>;
    let reach = window(pixel % step.size.x, step.size.x);
    for (var offset = reach.x; offset <= reach.y; offset++) {
        let weight = WINDOW[offset + HALF];
        let other = u32(i32(pixel) + offset);
        let a = drawn(other);
        let b = taken(other);
        means[0] += weight * a;
        means[1] += weight * b;
        means[2] += weight * (a * a);
        means[3] += weight * (b * b);
        means[4] += weight * (a * b);
    }
    for (var i = 0u; i < MEANS; i++) {
        for (var channel = 0u; channel < 3u; channel++) {
            blurred[slot(i, channel, pixel)] = means[i][channel];
        }
    }
}

@compute @workgroup_size(GROUP)
fn compare(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = thread(group, groups, local);
    if pixel >= pixels() {
        return;
    }
    let reach = window(pixel / step.size.x, step.size.y);
    var similarities = 0.0;
    for (var channel = 0u; channel < 3u; channel++) {
        var means: array<f32, 5>;
        for (var offset = reach.x; offset <= reach.y; offset++) {
            let weight = WINDOW[offset + HALF];
            let other = u32(i32(pixel) + offset * i32(step.size.x));
            for (var i = 0u; i < MEANS; i++) {
                means[i] += weight * blurred[slot(i, channel, other)];
            }
        }
        let aa = means[0] * means[0];
        let bb = means[1] * means[1];
        let ab = means[0] * means[1];
        let light = 2.0 * ab + C1;
        let structure = 2.0 * (means[4] - ab) + C2;
        let lights = aa + bb + C1;
        let structures = (means[2] - aa) + (means[3] - bb) + C2;
        let scale = 1.0 / (lights * structures);
        let similarity = light * structure * scale;
        similarities += similarity;
        derivatives[slot(0u, channel, pixel)] = 2.0 * means[1] * (structure - light) * scale
            - 2.0 * means[0] * similarity * (1.0 / lights - 1.0 / structures);
        derivatives[slot(1u, channel, pixel)] = -similarity / structures;
        derivatives[slot(2u, channel, pixel)] = 2.0 * light * scale;
    }
    let difference = abs(drawn(pixel) - taken(pixel));
    differences[pixel] = vec2<f32>(difference.x + difference.y + difference.z, similarities);
}

@compute @workgroup_size(GROUP)
fn blur_derivatives(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = thread(group, groups, local);
    if pixel >= pixels() {
        return;
    }
    let reach = window(pixel % step.size.x, step.size.x);
    for (var i = 0u; i < 3u * DERIVATIVES; i++) {
        var sum = 0.0;
        for (var offset = reach.x; offset <= reach.y; offset++) {
            sum += WINDOW[offset + HALF] * derivatives[i * pixels() + u32(i32(pixel) + offset)];
        }
        blurred[i * pixels() + pixel] = sum;
    }
}

@compute @workgroup_size(GROUP)
fn loss_backward(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = thread(group, groups, local);
    if pixel >= pixels() {
        return;
    }
    if !is_seen(pixel) {
        d_picture[pixel] = vec4<f32>(0.0);
        return;
    }
    let reach = window(pixel / step.size.x, step.size.y);
    var by: array<vec3<f32>, 3>;
    for (var offset = reach.x; offset <= reach.y; offset++) {
        let weight = WINDOW[offset + HALF];
        let other = u32(i32(pixel) + offset * i32(step.size.x));
        for (var i = 0u; i < DERIVATIVES; i++) {
            by[i] += weight * vec3<f32>(
                blurred[slot(i, 0u, other)],
                blurred[slot(i, 1u, other)],
                blurred[slot(i, 2u, other)],
            );
        }
    }
    let a = drawn(pixel);
    let b = taken(pixel);
    let each = 1.0 / f32(3u * pixels());
    let by_structure = each * (by[0] + 2.0 * a * by[1] + b * by[2]);
    // The sign of NaN is not defined: what is not a number stays so by the other term.
    let gradient = (1.0 - LAMBDA) * each * sign(a - b) - LAMBDA * by_structure;
    d_picture[pixel] += vec4<f32>(gradient, 0.0);
}

// Sums of absolute differences and similarities over the picture, as bits of floats. One group.
@compute @workgroup_size(SCAN_GROUP)
fn sum_loss(@builtin(local_invocation_index) local: u32) {
    var sum = vec2<f32>(0.0);
    for (var pixel = local; pixel < pixels(); pixel += SCAN_GROUP) {
        sum += differences[pixel];
    }
    parts[local] = sum;
    for (var reach = SCAN_GROUP / 2u; reach > 0u; reach /= 2u) {
        workgroupBarrier();
        if local < reach {
            parts[local] += parts[local + reach];
        }
    }
    if local == 0u {
        state[ABSOLUTE] = bitcast<u32>(parts[0].x);
        state[SIMILARITY] = bitcast<u32>(parts[0].y);
    }
}
