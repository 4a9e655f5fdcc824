//! Tests of LPIPS. The trained weights cannot be distributed; other weights of the same shapes test the
//! arithmetic.

use std::collections::BTreeMap;

use super::convolution::Convolution;
use super::model::Lpips;
use super::network::{Block, LpipsNetwork, WeightTensor};
use crate::fit::fixtures::{alexnet, layer_weights as weights};
use crate::fit::loss::loss;
use crate::fit::views::Photograph;
use crate::raster::Real;

fn pattern<T: Real>(
    [width, height]: [usize; 2],
    [along, down, by_channel, period]: [usize; 4],
) -> Vec<[T; 4]> {
    let color = |i: usize, c: usize| (i % width * along + i / width * down + c * by_channel) % period;
    let level = |i: usize, c: usize| T::from_f64(color(i, c) as f64 / (period - 1) as f64);
    (0..width * height).map(|i| [level(i, 0), level(i, 1), level(i, 2), T::one()]).collect()
}

/// Distance by the same network in NumPy: `sliding_window_view`, `tensordot` and the formula of the paper
/// in double precision.
const DISTANCE_BY_NUMPY: f64 = 1.995_343_607_914_339_2;

#[test]
fn the_distance_matches_an_independent_program() {
    let lpips = Lpips::<f32>::new(&alexnet()).unwrap();
    assert_eq!((lpips.network(), lpips.network().to_string()), (LpipsNetwork::Alex, "AlexNet".into()));
    let (a, b) = (pattern([72, 60], [7, 13, 29, 64]), pattern([72, 60], [5, 11, 17, 32]));
    let distance = lpips.distance(&a, &b, 72);
    assert!((distance - DISTANCE_BY_NUMPY).abs() < 1e-5 * DISTANCE_BY_NUMPY, "{distance}");
    assert_eq!(lpips.distance_and_gradient(&a, &b, 72).0, distance);
    assert!((lpips.distance(&b, &a, 72) - distance).abs() < 1e-6, "symmetric");
    let (itself, gradient) = lpips.distance_and_gradient(&a, &a, 72);
    assert_eq!(itself, 0.0);
    assert!(gradient.as_flattened().iter().all(|g| *g == 0.0));
}

/// A network with the layers of AlexNet or VGG, and few channels.
fn small(kernels: [[usize; 3]; 3], pool: [usize; 2]) -> Lpips<f64> {
    let mut inputs = 3;
    let blocks = kernels.iter().enumerate().map(|(i, &[side, stride, padding])| {
        let layer = |inputs: usize, outputs: usize, [side, stride, padding]: [usize; 3]| {
            let count = inputs * outputs * side * side;
            let scale = (24.0 / (inputs * side * side) as f64).sqrt();
            let values: Vec<f64> = weights(count, i, scale).collect();
            Convolution::new(&values, weights(outputs, i + 9, 0.3).collect(), side, stride, padding)
        };
        let outputs = 5 + 4 * i;
        let convolutions = vec![layer(inputs, 6, [side, stride, padding]), layer(6, outputs, [3, 1, 1])];
        inputs = outputs;
        let head = (0..outputs).map(|channel| 0.1 + (channel % 3) as f64).collect();
        Block { pool: (i > 0).then_some(pool), convolutions, head }
    });
    Lpips { network: LpipsNetwork::Alex, blocks: blocks.collect() }
}

#[test]
fn the_gradient_matches_finite_differences() {
    for lpips in [small([[11, 4, 2], [5, 1, 2], [3, 1, 1]], [3, 2]), small([[3, 1, 1]; 3], [2, 2])] {
        let size = [33, 31];
        lpips.check_size(33, 31).unwrap();
        let (a, b) = (pattern::<f64>(size, [7, 13, 29, 64]), pattern(size, [5, 11, 17, 32]));
        let (_, gradient) = lpips.distance_and_gradient(&a, &b, 33);
        let largest = gradient.as_flattened().iter().fold(0.0, |m: f64, g| m.max(g.abs()));
        assert!(largest > 1e-6);
        for pixel in [0, 32, 200, 517, 700, 1022] {
            for c in 0..3 {
                let moved = |by: f64| {
                    let mut moved = a.clone();
                    moved[pixel][c] += by;
                    lpips.distance(&moved, &b, 33)
                };
                let expected = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                let found = gradient[pixel][c];
                assert!((found - expected).abs() < 1e-5 * largest, "{pixel} {c}: {found} {expected}");
            }
        }
    }
}

/// It has the paper's weight of 0.1 and no gradient at invalid pixels, on one thread as on three.
#[test]
fn lpips_is_a_term_of_the_loss() {
    let lpips = small([[3, 1, 1]; 3], [2, 2]);
    let image: Vec<[f64; 4]> = pattern([20, 18], [7, 13, 29, 64]);
    let pixels = (0..360_u32).map(|i| [i % 251, i * 7 % 256, i * 31 % 256, 255].map(|x| x as u8)).collect();
    let valid = (0..360).map(|i| i % 20 != 3).collect();
    let photograph = Photograph { width: 20, height: 18, pixels, valid };
    let on_threads = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
        pool.install(|| loss(&image, &photograph, Some(&lpips)))
    };
    let (with, without) = (on_threads(1), loss(&image, &photograph, None));
    assert_eq!(with, on_threads(3));
    let target = |i: usize| photograph.pixels[i].map(|byte| f64::from(byte) / 255.0);
    let targets: Vec<[f64; 4]> = (0..360).map(target).collect();
    let rendered: Vec<[f64; 4]> =
        (0..360).map(|i| if photograph.is_valid(i) { image[i] } else { targets[i] }).collect();
    let (distance, gradient) = lpips.distance_and_gradient(&rendered, &targets, 20);
    assert!(distance > 0.01 && (with.value - without.value - 0.1 * distance).abs() < 1e-12);
    for (i, (a, b)) in with.gradient.iter().zip(&without.gradient).enumerate() {
        for c in 0..3 {
            let expected = if photograph.is_valid(i) { b[c] + 0.1 * gradient[i][c] } else { 0.0 };
            assert!((a[c] - expected).abs() < 1e-15);
        }
    }
}

#[test]
fn black_images_and_dead_features_give_finite_results() {
    let lpips = small([[3, 1, 1]; 3], [2, 2]);
    let (black, b) = (vec![[0.0; 4]; 400], pattern([20, 20], [5, 11, 17, 32]));
    let dead = {
        let mut dead = small([[3, 1, 1]; 3], [2, 2]);
        let zeros = vec![0.0; 3 * 6 * 9];
        dead.blocks[0].convolutions[0] = Convolution::new(&zeros, vec![-1.0; 6], 3, 1, 1);
        dead
    };
    for lpips in [lpips, dead] {
        let (distance, gradient) = lpips.distance_and_gradient(&black, &b, 20);
        assert!(distance.is_finite() && gradient.as_flattened().iter().all(|g| g.is_finite()));
    }
}

#[test]
fn images_too_small_are_refused() {
    let lpips = Lpips::<f32>::new(&alexnet()).unwrap();
    assert_eq!(lpips.check_size(31, 31), Ok(()));
    let error = lpips.check_size(64, 20).unwrap_err();
    assert_eq!(error.to_string(), "LPIPS needs images of at least 31x31 pixels, not 64x20");
    assert!(lpips.check_size(0, 0).is_err());
}

fn refusal(change: impl FnOnce(&mut BTreeMap<String, WeightTensor>)) -> String {
    let mut tensors = alexnet();
    change(&mut tensors);
    match Lpips::<f32>::new(&tensors) {
        Ok(_) => panic!("accepted"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn errors_name_the_malformed_tensor() {
    for name in ["features.8.bias", "features.0.weight", "lin4.model.1.weight"] {
        let missing = refusal(|tensors| drop(tensors.remove(name)));
        assert_eq!(missing, format!("the LPIPS weights lack the tensor {name}"));
    }
    let shape = refusal(|tensors| tensors.get_mut("lin2.model.1.weight").unwrap().shape = vec![384]);
    assert!(shape.contains("lin2.model.1.weight") && shape.contains("[1, 384, 1, 1]"), "{shape}");
    let short = refusal(|tensors| tensors.get_mut("features.3.bias").unwrap().values.truncate(7));
    assert!(short.contains("features.3.bias"), "{short}");
    let zeros =
        |shape: [usize; 4]| WeightTensor { shape: shape.to_vec(), values: vec![0.0; shape.iter().product()] };
    let network = refusal(|tensors| {
        tensors.insert("features.0.weight".into(), zeros([64, 3, 7, 7]));
    });
    assert!(network.contains("[64, 3, 7, 7]") && network.contains("AlexNet"), "{network}");
    let vgg = refusal(|tensors| {
        tensors.insert("features.0.weight".into(), zeros([64, 3, 3, 3]));
    });
    assert!(vgg.contains("features.2.weight"), "{vgg}");
    let infinite = refusal(|tensors| tensors.get_mut("features.3.bias").unwrap().values[0] = f32::INFINITY);
    assert!(infinite.contains("features.3.bias") && infinite.contains("not finite"), "{infinite}");
}
