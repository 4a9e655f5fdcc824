//! Throughput of the package: 40,000 procedural Gaussians, encoded and decoded by one thread and by two,
//! in Gaussians and in bytes of package per second; and the surroundings of 100,000 moving ones, by one thread.

#[path = "../tests/common/mod.rs"]
mod common;

use codec::{Coder, EncodeOptions, Limits, Source, Surroundings, decode_parallel, encode, encode_parallel};
use common::{Shape, field, info};
use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use std::{hint::black_box, num::NonZero};

fn benches(criterion: &mut Criterion) {
    let info = info();
    for (coder, sh_degree) in Coder::ALL.into_iter().flat_map(|coder| [(coder, 0), (coder, 3)]) {
        let layers = vec![5_000, 10_000, 20_000];
        let options = EncodeOptions { coder, layers, ..EncodeOptions::default() };
        let shape = Shape { rows: 40_000, sh_degree, rotation_rates: false, ..Shape::full(0) };
        let field = field(shape, 1);
        let source = Source { info: &info, field: &field, plate: None };
        let package = encode(&source, &options).expect("a procedural field is valid");

        let mut group = criterion.benchmark_group(format!("codec/{}/sh{sh_degree}", coder.name()));
        let (elements, bytes) = (field.len() as u64, package.len() as u64);
        group.sample_size(10).throughput(Throughput::ElementsAndBytes { elements, bytes });
        for threads in [1, 2].into_iter().filter_map(NonZero::new) {
            let name = |what| format!("{what}/{threads} thread{}", if threads.get() > 1 { "s" } else { "" });
            let limits = Limits::default();
            let decode = || decode_parallel(black_box(&package), &limits, threads);
            let encode = || encode_parallel(black_box(&source), &options, threads);
            group.bench_function(name("decode"), |b| b.iter(decode));
            group.bench_function(name("encode"), |b| b.iter(encode));
        }
        group.finish();
    }

    let field = field(Shape { rows: 100_000, sh_degree: 0, rotation_rates: false, ..Shape::full(0) }, 1);
    let mut group = criterion.benchmark_group("codec/surroundings");
    group.sample_size(10);
    let find = || Surroundings::new(black_box(&field), None, info.up);
    group.bench_function("opening", |b| b.iter(|| find().opening()));
    group.bench_function("stand points", |b| b.iter(|| find().stand_points(0.0, (640, 480))));
    group.finish();
}

criterion_group!(codec, benches);
criterion_main!(codec);
