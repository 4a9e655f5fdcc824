//! Benchmarks the persistence diagram on 128^3 voxels, the grid of pruning: on a smooth density of 300 blobs,
//! similar to a subject, and on noise, in which about every fourteenth voxel is a maximum.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use refine::prune::{Connectivity, MergeTree};

/// Voxels along each axis.
const SIZE: usize = 128;

fn benches(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group(format!("prune/diagram/{SIZE}^3"));
    group.sample_size(10);
    for (name, values) in [("blobs", blobs()), ("noise", noise())] {
        let diagram = |values| MergeTree::new(values, [SIZE; 3], Connectivity::TwentySix).diagram();
        group.bench_function(name, |b| b.iter_batched(|| values.clone(), diagram, BatchSize::LargeInput));
    }
    group.finish();
}

/// Gaussians with standard deviations of 2 to 6 voxels, cut off at three standard deviations.
fn blobs() -> Vec<f32> {
    let mut values = vec![0.0; SIZE * SIZE * SIZE];
    let mut random = fastrand::Rng::with_seed(1);
    for _ in 0..300 {
        let center: [f32; 3] = std::array::from_fn(|_| random.f32() * SIZE as f32);
        let sigma = 2.0 + 4.0 * random.f32();
        let support =
            center.map(|c| (c - 3.0 * sigma).max(0.0) as usize..((c + 3.0 * sigma) as usize).min(SIZE));
        for z in support[2].clone() {
            for y in support[1].clone() {
                for x in support[0].clone() {
                    let offset = [x, y, z].map(|i| i as f32);
                    let squared: f32 = offset.iter().zip(center).map(|(a, b)| (a - b).powi(2)).sum();
                    values[x + SIZE * (y + SIZE * z)] += (-0.5 * squared / (sigma * sigma)).exp();
                }
            }
        }
    }
    values
}

fn noise() -> Vec<f32> {
    let mut random = fastrand::Rng::with_seed(2);
    (0..SIZE * SIZE * SIZE).map(|_| random.f32()).collect()
}

criterion_group!(prune, benches);
criterion_main!(prune);
