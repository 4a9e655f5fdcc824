//! Compares diagrams with GUDHI's diagrams in `gudhi_diagrams.txt`, written by `gudhi_diagrams.py`.

use std::path::Path;

use refine::prune::{Connectivity, MergeTree};

const TABLE: &str = include_str!("gudhi_diagrams.txt");

/// The upper 32 bits of Knuth's MMIX generator.
fn numbers(mut seed: u64) -> impl FnMut() -> u64 {
    move || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        seed >> 32
    }
}

fn noise(size: [usize; 3], seed: u64, levels: u64) -> Vec<u64> {
    let mut draw = numbers(seed);
    (0..size.iter().product()).map(|_| draw() % levels).collect()
}

/// Sparse points, box-filtered twice along each axis with windows of 5, scaled to `levels`.
fn smooth(size: [usize; 3], seed: u64, levels: u64) -> Vec<u64> {
    let mut field = noise(size, seed, 1000);
    field.iter_mut().filter(|value| **value < 990).for_each(|value| *value = 0);
    for axis in [0, 1, 2, 0, 1, 2] {
        let stride = [1, size[0], size[0] * size[1]][axis];
        let window = |index: usize| {
            let at = index / stride % size[axis];
            (at.saturating_sub(2)..=(at + 2).min(size[axis] - 1))
                .map(|i| field[index + i * stride - at * stride])
                .sum()
        };
        field = (0..field.len()).map(window).collect();
    }
    let most = *field.iter().max().unwrap();
    field.into_iter().map(|value| value * levels / most).collect()
}

/// Reads a complex in Perseus format and negates it, so that all finite values are above 0.
fn file(path: &Path) -> Option<(Vec<f64>, [usize; 3])> {
    let text = std::fs::read_to_string(path).ok()?;
    let mut words = text.split_ascii_whitespace();
    let dimension = words.next()?.parse().ok()?;
    let mut size = [1; 3];
    for axis in size.iter_mut().take(dimension) {
        *axis = words.next()?.parse().ok()?;
    }
    let values: Vec<f64> = words.map(|word| word.parse().unwrap()).collect();
    let top = values.iter().copied().filter(|value| value.is_finite()).fold(f64::MIN, f64::max) + 1.0;
    Some((values.iter().map(|value| top - value).collect(), size))
}

#[test]
fn diagrams_agree_with_gudhi() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/ph-gudhi");
    let mut compared = 0;
    for line in TABLE.lines() {
        let (name, pairs) = line.split_once(" | ").unwrap_or((line.trim_end_matches(" |"), ""));
        let words: Vec<&str> = name.split(' ').collect();
        let number = |word: usize| words[word].parse::<u64>().unwrap();
        let size = || [1, 2, 3].map(|word| number(word) as usize);
        let whole = |field: Vec<u64>| field.into_iter().map(|value| value as f64).collect();
        let (field, size): (Vec<f64>, _) = match words[0] {
            "noise" => (whole(noise(size(), number(4), number(5))), size()),
            "smooth" => (whole(smooth(size(), number(4), number(5))), size()),
            _ => match file(&folder.join(words[1])) {
                Some(read) => read,
                None => {
                    println!("skipped: {} is not there", folder.join(words[1]).display());
                    continue;
                }
            },
        };
        let connectivity = match *words.last().unwrap() {
            "6" => Connectivity::Six,
            _ => Connectivity::TwentySix,
        };
        let values = field.iter().map(|&value| value as f32).collect();
        let mut actual: Vec<(f32, f32)> =
            MergeTree::new(values, size, connectivity).diagram().iter().map(|f| (f.birth, f.death)).collect();
        actual.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let pair = |pair: &str| {
            let (birth, death) = pair.split_once(',').unwrap();
            (birth.parse::<f64>().unwrap() as f32, death.parse::<f64>().unwrap() as f32)
        };
        let expected: Vec<(f32, f32)> = pairs.split_ascii_whitespace().map(pair).collect();
        assert_eq!(actual, expected, "{name}");
        compared += 1;
    }
    assert!(compared >= 18, "{compared} diagrams compared");
}
