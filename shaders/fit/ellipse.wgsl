// Which tiles a splat reaches: for each row of tiles, how far its ellipse reaches to either side within
// that row.

// Tiles `start` to `end`, without the last.
struct Span {
    start: u32,
    end: u32,
}

// NaN gives `b`; the built-in functions may give either.
fn larger(a: f32, b: f32) -> f32 {
    return select(b, a, a > b);
}

fn smaller(a: f32, b: f32) -> f32 {
    return select(b, a, a < b);
}

// How many of `size` pixels along an axis have their centre before `x`, or one more.
fn pixels_before(x: f32, size: u32) -> u32 {
    let shifted = x + 0.5;
    if !(shifted > 0.0) {
        return 0u;
    }
    return u32(smaller(shifted, f32(size)));
}

// The rows of tiles that the box around a splat touches.
fn tile_rows(splat: Splat) -> Span {
    let start = pixels_before(splat.center.y - splat.reach.y, step.size.y);
    let end = pixels_before(splat.center.y + splat.reach.y, step.size.y);
    if start >= end {
        return Span(0u, 0u);
    }
    return Span(start / TILE, (end + TILE - 1u) / TILE);
}

// Either side of an ellipse is curved to one side: farthest as near to where it touches its box as
// can be.
fn side(splat: Splat, dy: f32, direction: f32) -> f32 {
    let left_over = larger(splat.far - splat.inverse.y * dy * dy, 0.0);
    return splat.center.x + splat.lean * dy + direction * sqrt(left_over / splat.inverse.x);
}

// The tiles of a row that a splat reaches.
fn tiles_of_row(splat: Splat, row: u32) -> Span {
    let first = f32(row * TILE) + 0.5;
    let last = f32(min((row + 1u) * TILE, step.size.y)) - 0.5;
    let top = larger(first - splat.center.y, -splat.reach.y);
    let bottom = smaller(last - splat.center.y, splat.reach.y);
    if top > bottom {
        return Span(0u, 0u);
    }
    let left = side(splat, smaller(larger(-splat.touch, top), bottom), -1.0);
    let right = side(splat, smaller(larger(splat.touch, top), bottom), 1.0);
    let start = pixels_before(left, step.size.x);
    let end = pixels_before(right, step.size.x);
    if start >= end {
        return Span(0u, 0u);
    }
    return Span(start / TILE, (end + TILE - 1u) / TILE);
}
