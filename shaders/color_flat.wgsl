// Colour of a field that looks the same from everywhere.

fn color_of(index: u32, direction: vec3<f32>) -> vec3<f32> {
    return base_color(gaussians[index]);
}
