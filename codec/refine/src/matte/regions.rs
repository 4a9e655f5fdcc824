//! Connected regions of masks: keeps those that hold a sure pixel and are large enough, and fills holes.

/// Keeps of `mask`, `width` in a row, the regions (connected by sides and corners) of at least `least` pixels with one
/// of `sure`.
pub(super) fn keep(mask: &mut [bool], sure: &[bool], width: usize, least: usize) {
    regions(mask, width, true, |mask, pixels| {
        if pixels.len() < least || !pixels.iter().any(|i| sure[*i as usize]) {
            pixels.iter().for_each(|i| mask[*i as usize] = false);
        }
    });
}

/// Fills the regions (connected by sides) outside of `mask` for which `is_hole` says so of their pixels, unless they reach
/// the border.
pub(super) fn fill(mask: &mut [bool], width: usize, is_hole: impl Fn(&[u32]) -> bool) {
    let height = mask.len() / width.max(1);
    mask.iter_mut().for_each(|is_in| *is_in = !*is_in);
    regions(mask, width, false, |mask, pixels| {
        let is_inside = |i: &u32| {
            let (x, y) = (*i as usize % width, *i as usize / width);
            x > 0 && y > 0 && x + 1 < width && y + 1 < height
        };
        if pixels.iter().all(is_inside) && is_hole(pixels) {
            pixels.iter().for_each(|i| mask[*i as usize] = false);
        }
    });
    mask.iter_mut().for_each(|is_in| *is_in = !*is_in);
}

/// Calls `with` for the pixels of each region of `mask`, which it may change at these.
fn regions(mask: &mut [bool], width: usize, by_corners: bool, mut with: impl FnMut(&mut [bool], &[u32])) {
    let mut is_seen: Vec<bool> = mask.iter().map(|is_in| !is_in).collect();
    let mut pixels: Vec<u32> = Vec::new();
    for first in 0..mask.len() {
        if is_seen[first] {
            continue;
        }
        is_seen[first] = true;
        pixels.clear();
        pixels.push(first as u32);
        let mut next = 0;
        while let Some(&i) = pixels.get(next) {
            next += 1;
            let (i, x) = (i as usize, i as usize % width);
            let mut visit = |j: usize| {
                if !std::mem::replace(&mut is_seen[j], true) {
                    pixels.push(j as u32);
                }
            };
            let [left, right] = [x > 0, x + 1 < width];
            for row in [i.checked_sub(width), Some(i), Some(i + width).filter(|j| *j < mask.len())] {
                let Some(j) = row else { continue };
                visit(j);
                if left && (by_corners || j == i) {
                    visit(j - 1);
                }
                if right && (by_corners || j == i) {
                    visit(j + 1);
                }
            }
        }
        with(mask, &pixels);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(text: &str) -> Vec<bool> {
        text.bytes().map(|c| c == b'#').collect()
    }

    #[test]
    fn islands_go() {
        let sure = mask(
            "#...#\
                         .....\
                         .....\
                         .#...\
                         .....",
        );
        let mut islands = mask(
            "##..#\
                                .....\
                                ..###\
                                .#...\
                                #...#",
        );
        keep(&mut islands, &sure, 5, 2);
        let kept = mask(
            ".....\
                         .....\
                         ..###\
                         .#...\
                         #....",
        );
        assert_eq!(islands[5..], kept[5..], "one without a sure pixel goes, corners connect");
        assert_eq!(islands[..5], mask("##..."), "a single pixel goes");
    }

    #[test]
    fn holes_are_filled_and_bays_are_not() {
        let mut ring = mask(
            "######\
                             #..#.#\
                             #..###\
                             ####.#\
                             ##...#\
                             ##.###",
        );
        fill(&mut ring, 6, |pixels| pixels.len() >= 3);
        let filled = mask(
            "######\
                           ####.#\
                           ######\
                           ####.#\
                           ##...#\
                           ##.###",
        );
        assert_eq!(ring, filled);
    }
}
