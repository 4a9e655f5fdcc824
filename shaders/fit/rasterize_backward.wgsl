// Stage rasterize_backward: from the gradient by the pixels to that by the splats.
//
// A group draws a tile again, front to back. Each thread holds a splat, and the pixels pass by: in a turn a
// thread looks at those that the thread with the splat in front of it looked at a turn ago. While they
// still pass the last of a group's splats, they already meet the first of the next. So all that a splat
// does in a tile is summed up by one thread, without atomics and always in the same order.
//
// Of a pixel's colours times their gradients, what is behind a fragment is what is left of the sum; nothing
// has to be divided by a transmittance, which can be tiny.

@group(0) @binding(14) var<storage, read> picture: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read> d_picture: array<vec4<f32>>;
// By pair, SPLAT_NUMBERS each.
@group(0) @binding(20) var<storage, read_write> d_pairs: array<f32>;

const PIXELS: u32 = TILE * TILE;

// Of each pixel of the tile: the transmittance in front of the next splat, 0 once the pixel is finished,
// and what is left of the sum.
var<workgroup> pixels: array<vec2<f32>, PIXELS>;
var<workgroup> d_pixels: array<vec4<f32>, PIXELS>;
// Of each thread, whether it has met a pixel that was not finished.
var<workgroup> are_lit: array<u32, GROUP>;
var<workgroup> is_lit: u32;

// Of the gradient by the exponent of a splat's footprint, `-q / 2`, times powers of the place, and of that
// by its colour; `project_backward` makes of them what they stand for.
struct Sums {
    // Times 1, s and dy.
    by_place: vec3<f32>,
    // Times s s, s dy and dy dy.
    by_square: vec3<f32>,
    by_color: vec3<f32>,
}

fn leave(pair: u32, sums: Sums) {
    let to = pair * SPLAT_NUMBERS;
    for (var k = 0u; k < 3u; k++) {
        d_pairs[to + k] = sums.by_place[k];
        d_pairs[to + 3u + k] = sums.by_square[k];
        d_pairs[to + 6u + k] = sums.by_color[k];
    }
}

@compute @workgroup_size(GROUP)
fn rasterize_backward(@builtin(workgroup_id) tile: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let corner = tile.xy * TILE;
    for (var k = local; k < PIXELS; k += GROUP) {
        let pixel = corner + vec2<u32>(k % TILE, k / TILE);
        var d_pixel = vec4<f32>(0.0);
        var state = vec2<f32>(0.0);
        if all(pixel < step.size) {
            let place = pixel.y * step.size.x + pixel.x;
            d_pixel = d_picture[place];
            state = vec2<f32>(1.0, dot(picture[place], d_pixel));
        }
        d_pixels[k] = d_pixel;
        pixels[k] = state;
    }
    workgroupBarrier();

    let index = tile.y * step.tiles.x + tile.x;
    let end = tile_starts[index + 1u];
    // The place of the next splat that the thread takes, and the pair of the one that it has.
    var next = tile_starts[index] + local;
    var has_splat = false;
    var pair = 0u;
    var splat: Splat;
    var sums: Sums;
    // In the last round pixels pass the last splats.
    let rounds = (end - tile_starts[index] + GROUP - 1u) / GROUP + 1u;
    for (var round = 0u; round < rounds; round++) {
        var lit = false;
        for (var turn = 0u; turn < GROUP; turn++) {
            if turn == local {
                if has_splat {
                    leave(pair, sums);
                }
                has_splat = next < end;
                if has_splat {
                    pair = tile_pairs[next];
                    splat = splats[pair_rows[pair]];
                    sums = Sums();
                    next += GROUP;
                }
            }
            if has_splat {
                for (var k = (turn - local) % GROUP; k < PIXELS; k += GROUP) {
                    lit = pass_by(k, corner, splat, &sums) || lit;
                }
            }
            workgroupBarrier();
        }
        are_lit[local] = select(0u, 1u, lit);
        workgroupBarrier();
        if local == 0u {
            var any_lit = 0u;
            for (var k = 0u; k < GROUP; k++) {
                any_lit |= are_lit[k];
            }
            is_lit = any_lit;
        }
        if workgroupUniformLoad(&is_lit) == 0u {
            break;
        }
    }
    // No light comes to what is left.
    if has_splat {
        leave(pair, sums);
    }
    for (; next < end; next += GROUP) {
        leave(tile_pairs[next], Sums());
    }
}

// A pixel passes a splat, unless it was finished before.
fn pass_by(k: u32, corner: vec2<u32>, splat: Splat, sums: ptr<function, Sums>) -> bool {
    let transmittance = pixels[k].x;
    if !(transmittance > 0.0) {
        return false;
    }
    let drawn = fragment(splat, corner + vec2<u32>(k % TILE, k / TILE), transmittance);
    var rest = pixels[k].y;
    if drawn.weight > 0.0 {
        let d_pixel = d_pixels[k];
        let gain = dot(splat.color, d_pixel.xyz) + d_pixel.w;
        rest -= drawn.weight * gain;
        if drawn.is_free {
            let e = (transmittance * gain - rest / (1.0 - drawn.alpha)) * drawn.alpha;
            (*sums).by_place += e * vec3<f32>(1.0, drawn.s, drawn.dy);
            (*sums).by_square += e * vec3<f32>(drawn.s * drawn.s, drawn.s * drawn.dy, drawn.dy * drawn.dy);
        }
        (*sums).by_color += drawn.weight * d_pixel.xyz;
    }
    pixels[k] = vec2<f32>(drawn.transmittance_behind, rest);
    return true;
}
