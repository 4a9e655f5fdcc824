// Stage camera: the image as the camera shows it, and the gradient with respect to the camera.
//
// respond: from the image to what the camera shows of it. respond_backward: the gradient the same way back.
// sum_response: the gradient with respect to the response, one group. sum_view: the gradient with respect to
// the view, one group.
//
// What the camera adds to a colour counts by alpha, because the image is premultiplied.

struct Response {
    // Rows give red, green and blue: three factors of the image's colours, and an addend.
    color: array<vec4<f32>, 3>,
    // v of the factor 1 + v r^2, where r is 1 in the corners.
    vignette: f32,
}

@group(0) @binding(3) var<storage, read_write> totals: array<u32>;
@group(0) @binding(14) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read_write> d_image: array<vec4<f32>>;
@group(0) @binding(28) var<uniform> response: Response;
// The image as the camera shows it.
@group(0) @binding(29) var<storage, read_write> seen: array<vec4<f32>>;
@group(0) @binding(30) var<storage, read_write> d_view: array<ViewGradient>;
// Time, rotation, translation, logarithm of the focal lengths, colours, vignette.
@group(0) @binding(31) var<storage, read_write> d_camera: array<f32>;

// Numbers of the response and of the view, and the place of the response in `d_camera`.
const RESPONSE_NUMBERS: u32 = 13u;
const VIEW_NUMBERS: u32 = 8u;

var<workgroup> parts: array<f32, SCAN_GROUP>;

fn pixels() -> u32 {
    return uniforms.size.x * uniforms.size.y;
}

// Square of the distance of a pixel from the centre of the image, 1 in the corners.
fn square_of(pixel: u32) -> f32 {
    let size = vec2<f32>(uniforms.size);
    let at = vec2<f32>(f32(pixel % uniforms.size.x), f32(pixel / uniforms.size.x)) - 0.5 * (size - 1.0);
    return 4.0 * dot(at, at) / dot(size, size);
}

fn factor_at(square: f32) -> f32 {
    return 1.0 + square * response.vignette;
}

fn color_of(pixel: vec4<f32>) -> vec3<f32> {
    return vec3<f32>(
        dot(response.color[0], pixel),
        dot(response.color[1], pixel),
        dot(response.color[2], pixel),
    );
}

@compute @workgroup_size(GROUP)
fn respond(at: Invocation) {
    let pixel = thread(at);
    if pixel < pixels() {
        seen[pixel] = vec4<f32>(factor_at(square_of(pixel)) * color_of(image[pixel]), image[pixel].w);
    }
}

@compute @workgroup_size(GROUP)
fn respond_backward(at: Invocation) {
    let pixel = thread(at);
    if pixel < pixels() {
        let d_seen = d_image[pixel];
        let d_color = d_seen.xyz * factor_at(square_of(pixel));
        d_image[pixel] = vec4<f32>(0.0, 0.0, 0.0, d_seen.w)
            + d_color.x * response.color[0] + d_color.y * response.color[1] + d_color.z * response.color[2];
    }
}

// Sums a number over the threads of the group; the first thread gets the sum.
fn summed(local: u32, number: f32) -> f32 {
    workgroupBarrier();
    parts[local] = number;
    for (var stride = SCAN_GROUP / 2u; stride > 0u; stride /= 2u) {
        workgroupBarrier();
        if local < stride {
            parts[local] += parts[local + stride];
        }
    }
    return parts[0];
}

// Reads `d_image` before `respond_backward` changes it.
@compute @workgroup_size(SCAN_GROUP)
fn sum_response(@builtin(local_invocation_index) local: u32) {
    var by_color: array<vec4<f32>, 3>;
    var by_vignette = 0.0;
    for (var pixel = local; pixel < pixels(); pixel += SCAN_GROUP) {
        let square = square_of(pixel);
        let d_seen = d_image[pixel].xyz;
        let d_color = d_seen * factor_at(square);
        by_color[0] += d_color.x * image[pixel];
        by_color[1] += d_color.y * image[pixel];
        by_color[2] += d_color.z * image[pixel];
        by_vignette += dot(d_seen, color_of(image[pixel])) * square;
    }
    for (var number = 0u; number < RESPONSE_NUMBERS; number++) {
        let mine = select(by_color[min(number / 4u, 2u)][number % 4u], by_vignette, number == 12u);
        let sum = summed(local, mine);
        if local == 0u {
            d_camera[VIEW_NUMBERS + number] = sum;
        }
    }
}

@compute @workgroup_size(SCAN_GROUP)
fn sum_view(@builtin(local_invocation_index) local: u32) {
    var sum: ViewGradient;
    for (var i = local; i < totals[DRAWN]; i += SCAN_GROUP) {
        sum.rotation += d_view[i].rotation;
        sum.time += d_view[i].time;
        sum.center += d_view[i].center;
        sum.log_focal += d_view[i].log_focal;
    }
    let center = vec4<f32>(sum.center, 0.0);
    var numbers = array<f32, VIEW_NUMBERS>(
        sum.time,
        sum.rotation.x,
        sum.rotation.y,
        sum.rotation.z,
        dot(uniforms.view_from_world[0], center),
        dot(uniforms.view_from_world[1], center),
        dot(uniforms.view_from_world[2], center),
        sum.log_focal,
    );
    for (var number = 0u; number < VIEW_NUMBERS; number++) {
        let total = summed(local, numbers[number]);
        if local == 0u {
            d_camera[number] = total;
        }
    }
}
