// Stage rasterize_backward: backpropagates the gradient from pixels to splats.
//
// In: splats, pairs by tile, the image and its gradient. Out: per pair, the sums of `Sums`, from which
// `project_backward` computes the gradient of the splat.
//
// One group per tile composites it again, front to back. Each thread holds a splat and the pixels pass by:
// in a turn, a thread visits the pixels that the thread with the splat in front visited a turn before. The
// next round of splats starts while the last pixels still pass this one. One thread therefore sums all
// that a splat contributes to a tile, without atomics and in a fixed order.
//
// `rest` = sum over the fragments behind of their colour dot the pixel's gradient: the total minus the
// running sum. Nothing is divided by a transmittance, which can be tiny.

@group(0) @binding(14) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(19) var<storage, read> d_image: array<vec4<f32>>;
// By pair, SPLAT_NUMBERS each.
@group(0) @binding(20) var<storage, read_write> d_pairs: array<f32>;

const PIXELS: u32 = TILE * TILE;

// Per pixel of the tile: the transmittance in front of the next splat, 0 once saturated; and `rest`.
var<workgroup> pixels: array<vec2<f32>, PIXELS>;
var<workgroup> d_pixels: array<vec4<f32>, PIXELS>;
// Per thread, whether it visited a pixel that was not saturated.
var<workgroup> are_lit: array<u32, GROUP>;
var<workgroup> is_lit: u32;

// Sums over the pixels of a tile, for a splat: of the derivative with respect to the exponent `-q / 2`,
// times powers of the fragment's offset; and of the derivative with respect to the colour.
struct Sums {
    // Times 1, s and dy.
    by_offset: vec3<f32>,
    // Times s s, s dy and dy dy.
    by_square: vec3<f32>,
    by_color: vec3<f32>,
}

fn store_sums(pair: u32, sums: Sums) {
    let to = pair * SPLAT_NUMBERS;
    for (var k = 0u; k < 3u; k++) {
        d_pairs[to + k] = sums.by_offset[k];
        d_pairs[to + 3u + k] = sums.by_square[k];
        d_pairs[to + 6u + k] = sums.by_color[k];
    }
}

// Loads the pixels of the tile.
fn load_pixels(corner: vec2<u32>, local: u32) {
    for (var k = local; k < PIXELS; k += GROUP) {
        let pixel = corner + vec2<u32>(k % TILE, k / TILE);
        var d_pixel = vec4<f32>(0.0);
        var state = vec2<f32>(0.0);
        if all(pixel < uniforms.size) {
            let place = pixel.y * uniforms.size.x + pixel.x;
            d_pixel = d_image[place];
            state = vec2<f32>(1.0, dot(image[place], d_pixel));
        }
        d_pixels[k] = d_pixel;
        pixels[k] = state;
    }
    workgroupBarrier();
}

// Adds the fragment of `splat` at pixel `k` of the tile to `sums`. Returns false for a saturated pixel.
fn visit(k: u32, corner: vec2<u32>, splat: Splat, sums: ptr<function, Sums>) -> bool {
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
        if drawn.has_gradient {
            let e = (transmittance * gain - rest / (1.0 - drawn.alpha)) * drawn.alpha;
            (*sums).by_offset += e * vec3<f32>(1.0, drawn.s, drawn.dy);
            (*sums).by_square += e * vec3<f32>(drawn.s * drawn.s, drawn.s * drawn.dy, drawn.dy * drawn.dy);
        }
        (*sums).by_color += drawn.weight * d_pixel.xyz;
    }
    pixels[k] = vec2<f32>(drawn.transmittance_behind, rest);
    return true;
}

// The kernel is one loop, and 60 lines long, because its barriers need uniform control flow.
@compute @workgroup_size(GROUP)
fn rasterize_backward(@builtin(workgroup_id) tile: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let corner = tile.xy * TILE;
    load_pixels(corner, local);
    let index = tile.y * uniforms.tiles.x + tile.x;
    let end = tile_starts[index + 1u];
    // Index of the thread's next splat, and the pair of its current one.
    var next = tile_starts[index] + local;
    var has_splat = false;
    var pair = 0u;
    var splat: Splat;
    var sums: Sums;
    // In the last round, pixels pass the last splats.
    let rounds = (end - tile_starts[index] + GROUP - 1u) / GROUP + 1u;
    for (var round = 0u; round < rounds; round++) {
        var lit = false;
        for (var turn = 0u; turn < GROUP; turn++) {
            if turn == local {
                if has_splat {
                    store_sums(pair, sums);
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
                    lit = visit(k, corner, splat, &sums) || lit;
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
    // All pixels are saturated: the other splats have zero gradients.
    if has_splat {
        store_sums(pair, sums);
    }
    for (; next < end; next += GROUP) {
        store_sums(tile_pairs[next], Sums());
    }
}
