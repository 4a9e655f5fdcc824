// Vertex entry point for one eye per pass.

@vertex
fn vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) batch: u32) -> Splat {
    return splat(index % CORNERS, batch * BATCH + index / CORNERS, 0u);
}
