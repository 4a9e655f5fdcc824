//! [`layer_views`]: texture views of an image with one layer per eye.

/// Render targets of the passes, with `format`: one view of `eyes_per_pass` layers of `texture` per pass.
pub(super) fn layer_views(
    texture: &wgpu::Texture,
    format: wgpu::TextureFormat,
    eyes_per_pass: u32,
) -> Vec<wgpu::TextureView> {
    let view = |layer| {
        texture.create_view(&wgpu::TextureViewDescriptor {
            format: Some(format),
            dimension: Some(match eyes_per_pass {
                1 => wgpu::TextureViewDimension::D2,
                _ => wgpu::TextureViewDimension::D2Array,
            }),
            usage: Some(wgpu::TextureUsages::RENDER_ATTACHMENT),
            base_array_layer: layer,
            array_layer_count: Some(eyes_per_pass),
            ..Default::default()
        })
    };
    (0..texture.depth_or_array_layers()).step_by(eyes_per_pass as usize).map(view).collect()
}
