// All eyes in one pass, each in a layer of the target.

@vertex
fn vertex(
    @builtin(vertex_index) index: u32,
    @builtin(instance_index) batch: u32,
    @builtin(view_index) eye: u32,
) -> Splat {
    return splat(index % CORNERS, batch * BATCH + index / CORNERS, eye);
}
