// Vertex entry point for all eyes in one pass, one target layer per eye.

@vertex
fn vertex(
    @builtin(vertex_index) index: u32,
    @builtin(instance_index) batch: u32,
    @builtin(view_index) eye: u32,
) -> Splat {
    return splat(index % CORNERS, batch * BATCH + index / CORNERS, eye);
}
