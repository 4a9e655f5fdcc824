//! [`layer_views`] and [`sampled_views`]: texture views of an image with one layer per eye.

use wgpu::{TextureUsages, TextureViewDescriptor, TextureViewDimension};

/// Render targets of the passes, with `format`: one view of `eyes_per_pass` layers of `texture` per pass.
pub(super) fn layer_views(
    texture: &wgpu::Texture,
    format: wgpu::TextureFormat,
    eyes_per_pass: u32,
) -> Vec<wgpu::TextureView> {
    let dimension = match eyes_per_pass {
        1 => TextureViewDimension::D2,
        _ => TextureViewDimension::D2Array,
    };
    let target = TextureViewDescriptor {
        format: Some(format),
        dimension: Some(dimension),
        usage: Some(TextureUsages::RENDER_ATTACHMENT),
        ..Default::default()
    };
    views_by_pass(texture, eyes_per_pass, &target)
}

/// Views for sampling in the passes: one of `eyes_per_pass` layers of `texture` per pass.
pub(super) fn sampled_views(texture: &wgpu::Texture, eyes_per_pass: u32) -> Vec<wgpu::TextureView> {
    let sampled = TextureViewDescriptor {
        dimension: Some(TextureViewDimension::D2Array),
        usage: Some(TextureUsages::TEXTURE_BINDING),
        ..Default::default()
    };
    views_by_pass(texture, eyes_per_pass, &sampled)
}

/// Views like `view`, each of the layers of one pass.
fn views_by_pass(
    texture: &wgpu::Texture,
    eyes_per_pass: u32,
    view: &TextureViewDescriptor<'_>,
) -> Vec<wgpu::TextureView> {
    let of_pass = |layer| {
        texture.create_view(&TextureViewDescriptor {
            base_array_layer: layer,
            array_layer_count: Some(eyes_per_pass),
            ..view.clone()
        })
    };
    (0..texture.depth_or_array_layers()).step_by(eyes_per_pass as usize).map(of_pass).collect()
}
