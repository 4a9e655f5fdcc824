//! Compares with forward renders of gsplat to 1e-5, which pins the conventions of the rasteriser.

use std::path::Path;

use codec::{Camera, Field};
use refine::reference::{Order, RenderScene, render};
use safetensors::SafeTensors;

fn floats(file: &SafeTensors, name: &str) -> (Vec<usize>, Vec<f32>) {
    let tensor = file.tensor(name).unwrap_or_else(|error| panic!("{name}: {error}"));
    let values = tensor.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    (tensor.shape().to_vec(), values.collect())
}

fn rows<const N: usize>(file: &SafeTensors, name: &str) -> Vec<[f32; N]> {
    floats(file, name).1.as_chunks().0.to_vec()
}

fn normalized(q: [f32; 4]) -> [f32; 4] {
    let length = q.iter().map(|c| f64::from(*c) * f64::from(*c)).sum::<f64>().sqrt();
    q.map(|c| (f64::from(c) / length) as f32)
}

#[test]
fn gsplat_renders_are_reproduced() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/raster-reference/brush");
    for name in ["tiny_case.safetensors", "basic_case.safetensors"] {
        let Ok(bytes) = std::fs::read(folder.join(name)) else {
            println!("skipped: {} is not there", folder.join(name).display());
            continue;
        };
        let file = SafeTensors::deserialize(&bytes).unwrap();
        let (shape, expected) = floats(&file, "out_img");
        let (width, height) = (shape[1] as u32, shape[0] as u32);
        let (coefficients, sh) = (floats(&file, "coeffs").0[1], rows(&file, "coeffs"));
        let field = Field {
            centers: rows(&file, "means"),
            rotations: rows(&file, "quats").into_iter().map(normalized).collect(),
            log_scales: rows(&file, "scales"),
            opacities: floats(&file, "opacities").1.iter().map(|o| 1.0 / (1.0 + (-o).exp())).collect(),
            sh_degree: coefficients.isqrt() as u8 - 1,
            sh,
            temporal: None,
        };
        field.check().unwrap();
        let (w, h) = (f64::from(width), f64::from(height));
        let camera = Camera {
            width,
            height,
            k: [[0.5 * w, 0.0, 0.5 * w], [0.0, 0.5 * w, 0.5 * h], [0.0, 0.0, 1.0]],
            camera_from_world: [
                [1.0, 0.0, 0.0, -0.123],
                [0.0, 1.0, 0.0, -0.456],
                [0.0, 0.0, 1.0, 8.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
        };
        let image = render(&RenderScene::from(&field), &camera, 0.0, Order::Depth);
        let differences =
            image.pixels.iter().flatten().zip(&expected).map(|(a, b)| (a - f64::from(*b)).abs());
        let worst = differences.fold(0.0, f64::max);
        println!("{name}: {} Gaussians, {width}x{height}, largest difference {worst:.2e}", field.len());
        assert!(expected.iter().any(|c| *c > 0.5), "{name} is not black");
        assert!(worst <= 1e-5, "{name}: {worst}");
    }
}
