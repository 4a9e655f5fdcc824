// Colour, degree 0: the same from all directions.
//
// Input: a Gaussian's record. Output: its display-referred colour.

fn color_of(index: u32, direction: vec3<f32>) -> vec3<f32> {
    return base_color(gaussians[index]);
}
