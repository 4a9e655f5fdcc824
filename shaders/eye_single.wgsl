// One eye a pass.

@vertex
fn vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) instance: u32) -> Splat {
    return splat(corner, instance, 0u);
}
