// All eyes in one pass, each in a layer of the target.

@vertex
fn vertex(
    @builtin(vertex_index) corner: u32,
    @builtin(instance_index) instance: u32,
    @builtin(view_index) eye: u32,
) -> Splat {
    return splat(corner, instance, eye);
}
