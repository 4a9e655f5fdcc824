//! Throughput of the package: 40,000 procedural Gaussians, encoded and decoded, in Gaussians and
//! in bytes of package per second.

#[path = "../tests/common/mod.rs"]
mod common;

use codec::{Coder, EncodeOptions, Limits, Source, decode, encode};
use common::{Shape, field, info};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;

fn benches(criterion: &mut Criterion) {
    let info = info();
    for (coder, sh_degree) in [(Coder::Fixed, 0), (Coder::Fixed, 3), (Coder::Context, 0), (Coder::Context, 3)]
    {
        let layers = vec![5_000, 10_000, 20_000];
        let options = EncodeOptions { coder, layers, ..EncodeOptions::default() };
        let shape = Shape { rows: 40_000, sh_degree, rotation_rates: false, ..Shape::full(0) };
        let field = field(shape, 1);
        let source = Source { info: &info, field: &field, plate: None };
        let package = encode(&source, &options).expect("a procedural field is valid");

        let mut group = criterion.benchmark_group(format!("codec/{}/sh{sh_degree}", coder.name()));
        let (elements, bytes) = (field.len() as u64, package.len() as u64);
        group.sample_size(10).throughput(Throughput::ElementsAndBytes { elements, bytes });
        group.bench_function("decode", |b| b.iter(|| decode(black_box(&package), &Limits::default())));
        group.bench_function("encode", |b| b.iter(|| encode(black_box(&source), &options)));
        group.finish();
    }
}

criterion_group!(codec, benches);
criterion_main!(codec);
