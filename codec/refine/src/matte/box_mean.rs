//! [`box_mean`]: means over squares around each pixel, by running sums: the cost does not depend on the radius.

/// Means of `values`, `width` in a row, over the squares of `radius` pixels from each pixel, as far as they are
/// inside the picture.
pub(super) fn box_mean(values: &[f32], width: usize, radius: usize) -> Vec<f32> {
    let height = values.len() / width.max(1);
    let count = |at: usize, size: usize| (at + radius).min(size - 1) - at.saturating_sub(radius) + 1;
    let across: Vec<f32> = (0..width).map(|x| 1.0 / count(x, width) as f32).collect();
    let mut means = vec![0.0; values.len()];
    // Sums of the columns in the rows around the current one.
    let mut columns = vec![0.0f32; width];
    let row = |y: usize| &values[y * width..][..width];
    let add = |columns: &mut [f32], y: usize, factor: f32| {
        columns.iter_mut().zip(row(y)).for_each(|(sum, value)| *sum += factor * value);
    };
    (0..radius.min(height)).for_each(|y| add(&mut columns, y, 1.0));
    for (y, means) in means.chunks_exact_mut(width.max(1)).enumerate() {
        if y + radius < height {
            add(&mut columns, y + radius, 1.0);
        }
        if y > radius {
            add(&mut columns, y - radius - 1, -1.0);
        }
        let down = 1.0 / count(y, height) as f32;
        let mut sum: f32 = columns[..radius.min(width)].iter().sum();
        for x in 0..width {
            if x + radius < width {
                sum += columns[x + radius];
            }
            if x > radius {
                sum -= columns[x - radius - 1];
            }
            means[x] = sum * across[x] * down;
        }
    }
    means
}

/// Radius in pixels, at least 1, in a picture with this number of them, of a part of the square root of that number.
pub(super) fn radius_of(pixels: usize, part: f64) -> usize {
    ((part * (pixels as f64).sqrt()).round() as usize).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_those_of_the_squares() {
        for (width, height, radius) in [(1, 1, 0), (1, 1, 9), (7, 5, 1), (7, 5, 2), (3, 9, 4), (16, 2, 3)] {
            let values: Vec<f32> = (0..width * height).map(|i| ((i * 37 + 11) % 101) as f32).collect();
            let means = box_mean(&values, width, radius);
            for (i, mean) in means.into_iter().enumerate() {
                let near = |j: &usize| {
                    (i % width).abs_diff(j % width) <= radius && (i / width).abs_diff(j / width) <= radius
                };
                let square: Vec<f32> = (0..values.len()).filter(near).map(|j| values[j]).collect();
                let expected = square.iter().sum::<f32>() / square.len() as f32;
                assert!((mean - expected).abs() < 1e-3, "{width}x{height}, {radius}, {i}: {mean} {expected}");
            }
        }
        assert!(box_mean(&[], 0, 3).is_empty());
    }
}
