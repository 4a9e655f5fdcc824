// The tiles that a splat overlaps: per row of tiles, the span of its ellipse within that row.

// Tiles from `start` up to, but not including, `end`.
struct Span {
    start: u32,
    end: u32,
}

// NaN gives `b`; the built-in functions may return either.
fn larger(a: f32, b: f32) -> f32 {
    return select(b, a, a > b);
}

fn smaller(a: f32, b: f32) -> f32 {
    return select(b, a, a < b);
}

// Number of pixels, of `size` along an axis, with their centre below `x`; possibly one more.
fn pixels_below(x: f32, size: u32) -> u32 {
    let shifted = x + 0.5;
    if !(shifted > 0.0) {
        return 0u;
    }
    return u32(smaller(shifted, f32(size)));
}

// The tiles of the pixels from `start` to `end` along an axis of `size` pixels.
fn tile_span(start: f32, end: f32, size: u32) -> Span {
    let first = pixels_below(start, size);
    let last = pixels_below(end, size);
    if first >= last {
        return Span(0u, 0u);
    }
    return Span(first / TILE, (last + TILE - 1u) / TILE);
}

// The rows of tiles that the bounding box of a splat overlaps.
fn tile_rows(splat: Splat) -> Span {
    return tile_span(
        splat.center.y - splat.half_extent.y,
        splat.center.y + splat.half_extent.y,
        uniforms.size.y,
    );
}

// x of the ellipse at `dy`, on the right for direction 1 and on the left for -1.
fn side(splat: Splat, dy: f32, direction: f32) -> f32 {
    let rest = larger(splat.q_max - splat.inverse_variance.y * dy * dy, 0.0);
    return splat.center.x + splat.shear * dy + direction * sqrt(rest / splat.inverse_variance.x);
}

// The tiles of a row that a splat overlaps. Either side of the ellipse is convex: its extreme within the
// row is at the height closest to where it touches the bounding box.
fn tiles_of_row(splat: Splat, row: u32) -> Span {
    let first = f32(row * TILE) + 0.5;
    let last = f32(min((row + 1u) * TILE, uniforms.size.y)) - 0.5;
    let top = larger(first - splat.center.y, -splat.half_extent.y);
    let bottom = smaller(last - splat.center.y, splat.half_extent.y);
    if top > bottom {
        return Span(0u, 0u);
    }
    let left = side(splat, smaller(larger(-splat.tangent_y, top), bottom), -1.0);
    let right = side(splat, smaller(larger(splat.tangent_y, top), bottom), 1.0);
    return tile_span(left, right, uniforms.size.x);
}
