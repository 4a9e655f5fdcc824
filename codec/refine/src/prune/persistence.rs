//! Superlevel persistence of connected components (H0) on a voxel grid.
//!
//! Lowering a threshold over a grid of values, components appear at local maxima and merge at
//! saddles; by the elder rule, the component with the lower maximum ends there. [`MergeTree`] records the
//! saddle and the parent of each. Values at or below 0 are background: components that never merge, the
//! essential class included, end at 0, so that every persistence is finite.
//!
//! Voxels are totally ordered by descending value, then by ascending index, so ties are deterministic.
//! Each voxel is labelled with the maximum that steepest ascent leads to. Two maxima can only meet where
//! voxels of both labels touch, so union-find over the maxima processes these contacts in order. All
//! other steps are parallel scans of the grid.

use std::collections::HashSet;

use rayon::prelude::*;

/// Which voxels are neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Connectivity {
    /// Voxels that share a face.
    Six,
    /// Voxels that share a face, edge or corner: a thin diagonal limb is connected.
    #[default]
    TwentySix,
}

/// A point of the persistence diagram: a component from its maximum to its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Value of the maximum.
    pub birth: f32,
    /// Value at which the component merges into an older one; 0 if it never does.
    pub death: f32,
    /// Index of the voxel of the maximum.
    pub birth_voxel: usize,
    /// Index of the voxel that joins it to the older component, if it merges.
    pub saddle_voxel: Option<usize>,
}

impl Feature {
    /// Birth minus death.
    pub fn persistence(&self) -> f32 {
        self.birth - self.death
    }
}

/// The index of no maximum or voxel.
const NONE: u32 = u32::MAX;

/// A local maximum in the total order, and the end of its component.
#[derive(Clone, Copy, Debug)]
struct Maximum {
    voxel: u32,
    /// The voxel that joins it to an older component, and the maximum of that component.
    saddle: u32,
    parent: u32,
}

/// The merge tree of the superlevel sets of a grid.
#[derive(Clone, Debug)]
pub struct MergeTree {
    values: Vec<f32>,
    neighbours: Neighbours,
    /// Per voxel, the maximum at the end of the steepest ascent.
    labels: Vec<u32>,
    /// Sorted from the highest down.
    maxima: Vec<Maximum>,
}

impl MergeTree {
    /// Builds the merge tree of a grid of `size` `[nx, ny, nz]`; the value at `x, y, z` is
    /// `values[x + nx (y + ny z)]`. The tree occupies 8 bytes per voxel. The result does not depend on the
    /// number of threads.
    ///
    /// # Panics
    /// If there are not `nx ny nz` values, or not less than 2^32 - 1.
    pub fn new(values: Vec<f32>, size: [usize; 3], connectivity: Connectivity) -> MergeTree {
        assert_eq!(values.len(), size.iter().product::<usize>(), "values of a grid of {size:?}");
        assert!(values.len() < NONE as usize, "a grid of less than 2^32 voxels");
        let neighbours = Neighbours::new(size, connectivity);
        let mut tree = MergeTree { values, neighbours, labels: Vec::new(), maxima: Vec::new() };
        tree.label();
        tree.merge();
        tree
    }

    /// Finds the maxima and labels each voxel with one.
    fn label(&mut self) {
        let tree = &*self;
        let steepest: Vec<u32> = tree.neighbours.scan(|place, voxel, found| {
            let up = if tree.values[voxel] > 0.0 { tree.steepest(place, voxel) } else { NONE };
            found.push(up);
        });
        let mut tops: Vec<u32> =
            (0..steepest.len() as u32).filter(|&voxel| steepest[voxel as usize] == voxel).collect();
        tops.sort_unstable_by_key(|&voxel| self.order(voxel));
        let mut labels = vec![NONE; steepest.len()];
        tops.iter().enumerate().for_each(|(maximum, &voxel)| labels[voxel as usize] = maximum as u32);
        let mut ascent = Vec::new();
        for start in (0..steepest.len()).filter(|&voxel| steepest[voxel] != NONE) {
            let mut voxel = start;
            while labels[voxel] == NONE {
                ascent.push(voxel);
                voxel = steepest[voxel] as usize;
            }
            let label = labels[voxel];
            ascent.drain(..).for_each(|voxel| labels[voxel] = label);
        }
        self.labels = labels;
        self.maxima = tops.into_iter().map(|voxel| Maximum { voxel, saddle: NONE, parent: NONE }).collect();
    }

    /// Finds the saddle and parent of each maximum.
    fn merge(&mut self) {
        let tree = &*self;
        // Pairs of a voxel and the label of an earlier neighbour with another label.
        let mut contacts: Vec<(u32, u32)> = tree.neighbours.scan(|place, voxel, found| {
            let own = tree.labels[voxel];
            if own == NONE {
                return;
            }
            let first = found.len();
            tree.neighbours.each_at(place, voxel, |neighbour| {
                let other = tree.labels[neighbour];
                if other != own
                    && other != NONE
                    && tree.precedes(neighbour as u32, voxel as u32)
                    && !found[first..].contains(&(voxel as u32, other))
                {
                    found.push((voxel as u32, other));
                }
            });
        });
        contacts.par_sort_unstable_by_key(|&(voxel, other)| (tree.order(voxel), other));
        let mut elders: Vec<u32> = (0..self.maxima.len() as u32).collect();
        let mut met = Vec::new();
        for contacts in contacts.chunk_by(|a, b| a.0 == b.0) {
            let saddle = contacts[0].0;
            met.clear();
            met.push(find(&mut elders, self.labels[saddle as usize]));
            met.extend(contacts.iter().map(|&(_, other)| find(&mut elders, other)));
            // Maxima are numbered from the highest down.
            met.sort_unstable();
            met.dedup();
            for &younger in &met[1..] {
                elders[younger as usize] = met[0];
                let maximum = &mut self.maxima[younger as usize];
                (maximum.saddle, maximum.parent) = (saddle, met[0]);
            }
        }
    }

    /// The persistence diagram without its diagonal, by descending birth.
    pub fn diagram(&self) -> Vec<Feature> {
        let features = (0..self.maxima.len()).map(|maximum| self.feature(maximum));
        features.filter(|feature| feature.persistence() > 0.0).collect()
    }

    /// Numbers of the maxima with persistence above `epsilon`, ascending.
    pub(crate) fn persistent(&self, epsilon: f32) -> Vec<usize> {
        (0..self.maxima.len()).filter(|&maximum| self.feature(maximum).persistence() > epsilon).collect()
    }

    /// The feature that starts at a maximum.
    pub(crate) fn feature(&self, maximum: usize) -> Feature {
        let Maximum { voxel, saddle, .. } = self.maxima[maximum];
        Feature {
            birth: self.values[voxel as usize],
            death: if saddle == NONE { 0.0 } else { self.values[saddle as usize] },
            birth_voxel: voxel as usize,
            saddle_voxel: (saddle != NONE).then_some(saddle as usize),
        }
    }

    /// The highest value; 0 if all voxels are background.
    pub(crate) fn largest(&self) -> f32 {
        self.maxima.first().map_or(0.0, |maximum| self.values[maximum.voxel as usize])
    }

    /// Value at a voxel.
    pub(crate) fn value(&self, voxel: usize) -> f32 {
        self.values[voxel]
    }

    /// The maximum that the component of `maximum` merges into.
    pub(crate) fn parent(&self, maximum: usize) -> Option<usize> {
        let parent = self.maxima[maximum].parent;
        (parent != NONE).then_some(parent as usize)
    }

    /// The maxima whose basins contain `voxel`, innermost first. The basin of a maximum is its component
    /// just before it merges into an older one. Empty for a background voxel.
    pub(crate) fn basins_around(&self, voxel: usize) -> impl Iterator<Item = usize> {
        let innermost = self.labels[voxel];
        let innermost = (innermost != NONE).then_some(innermost as usize);
        let outwards = std::iter::successors(innermost, |&maximum| self.parent(maximum));
        // A basin that ended above the value of the voxel does not contain it.
        outwards.skip_while(move |&maximum| {
            let saddle = self.maxima[maximum].saddle;
            saddle != NONE && !self.precedes(voxel as u32, saddle)
        })
    }

    /// Orders maxima by their saddles: the first to end comes first.
    pub(crate) fn by_saddle(&self, a: usize, b: usize) -> std::cmp::Ordering {
        let order = |maximum: usize| {
            let saddle = self.maxima[maximum].saddle;
            // Maxima that never merge come last: their saddle is below every voxel.
            let value = if saddle == NONE { 0.0 } else { self.values[saddle as usize] };
            (value, saddle, maximum)
        };
        let ((a, a_saddle, a_maximum), (b, b_saddle, b_maximum)) = (order(a), order(b));
        b.total_cmp(&a).then(a_saddle.cmp(&b_saddle)).then(a_maximum.cmp(&b_maximum))
    }

    /// Voxels of a path from `voxel` to `maximum`, whose basin contains it, with the highest possible
    /// lowest point. Sorted by index, both ends included.
    pub(crate) fn path(&self, voxel: usize, maximum: usize) -> Vec<usize> {
        let mut path = Vec::new();
        let mut crossed = HashSet::new();
        let mut legs = vec![(voxel as u32, maximum as u32)];
        while let Some((voxel, target)) = legs.pop() {
            let mut reached = self.climb(voxel, &mut path);
            while reached != target {
                // Cross the saddle into the older component: down from the maximum reached, which is a
                // leg of its own walked backwards, and up on the other side.
                let Maximum { saddle, parent, .. } = self.maxima[reached as usize];
                if crossed.insert(reached) {
                    path.push(saddle as usize);
                    legs.push((self.beside(saddle, reached), reached));
                    legs.push((self.beside(saddle, parent), parent));
                }
                reached = parent;
            }
        }
        path.sort_unstable();
        path.dedup();
        path
    }

    /// Voxels of a path from `maximum` over its saddle to its parent. Only `maximum` if it never merges.
    pub(crate) fn path_over_saddle(&self, maximum: usize) -> Vec<usize> {
        let Maximum { voxel, saddle, parent } = self.maxima[maximum];
        if saddle == NONE {
            return vec![voxel as usize];
        }
        let mut path = vec![saddle as usize];
        for side in [maximum as u32, parent] {
            path.extend(self.path(self.beside(saddle, side) as usize, side as usize));
        }
        path
    }

    /// Follows the steepest ascent from `voxel` to a local maximum and appends the voxels to `path`.
    fn climb(&self, mut voxel: u32, path: &mut Vec<usize>) -> u32 {
        loop {
            path.push(voxel as usize);
            let higher = self.steepest(self.neighbours.place(voxel as usize), voxel as usize);
            if higher == voxel {
                return self.labels[voxel as usize];
            }
            voxel = higher;
        }
    }

    /// The first of a voxel and its neighbours in the total order.
    fn steepest(&self, place: [usize; 3], voxel: usize) -> u32 {
        let mut first = voxel as u32;
        self.neighbours.each_at(place, voxel, |neighbour| {
            if self.precedes(neighbour as u32, first) {
                first = neighbour as u32;
            }
        });
        first
    }

    /// A neighbour of `saddle` in the component of `maximum` just before the merge.
    fn beside(&self, saddle: u32, maximum: u32) -> u32 {
        let mut found = saddle;
        let place = self.neighbours.place(saddle as usize);
        self.neighbours.each_at(place, saddle as usize, |neighbour| {
            let above = self.values[neighbour] > 0.0 && self.precedes(neighbour as u32, saddle);
            if above && self.component(neighbour, saddle) == maximum {
                found = neighbour as u32;
            }
        });
        found
    }

    /// The maximum of the component of `voxel` when all voxels before `until` are included.
    fn component(&self, voxel: usize, until: u32) -> u32 {
        let mut maximum = self.labels[voxel];
        loop {
            let Maximum { saddle, parent, .. } = self.maxima[maximum as usize];
            if saddle == NONE || !self.precedes(saddle, until) {
                return maximum;
            }
            maximum = parent;
        }
    }

    /// Whether voxel `a` comes before `b` in the total order.
    fn precedes(&self, a: u32, b: u32) -> bool {
        let (va, vb) = (self.values[a as usize], self.values[b as usize]);
        va > vb || (va == vb && a < b)
    }

    /// A sort key for the total order: the bits of positive floats sort like the floats.
    fn order(&self, voxel: u32) -> (u32, u32) {
        (!self.values[voxel as usize].to_bits(), voxel)
    }
}

/// The root of `maximum` in the union-find forest, by path halving.
fn find(elders: &mut [u32], mut maximum: u32) -> u32 {
    while elders[maximum as usize] != maximum {
        let elder = elders[maximum as usize];
        elders[maximum as usize] = elders[elder as usize];
        maximum = elder;
    }
    maximum
}

/// The neighbours of each voxel of a grid.
#[derive(Clone, Debug)]
struct Neighbours {
    size: [usize; 3],
    /// Steps along the axes, and the change of the index.
    steps: Vec<([isize; 3], isize)>,
}

impl Neighbours {
    fn new(size: [usize; 3], connectivity: Connectivity) -> Neighbours {
        let [nx, ny, _] = size.map(|n| n as isize);
        let mut steps = Vec::new();
        for dz in -1..=1isize {
            for dy in -1..=1isize {
                for dx in -1..=1isize {
                    let moves = dx.abs() + dy.abs() + dz.abs();
                    let most = if connectivity == Connectivity::Six { 1 } else { 3 };
                    if (1..=most).contains(&moves) {
                        steps.push(([dx, dy, dz], dx + nx * (dy + ny * dz)));
                    }
                }
            }
        }
        Neighbours { size, steps }
    }

    fn place(&self, voxel: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [voxel % nx, voxel / nx % ny, voxel / (nx * ny)]
    }

    /// Visits the neighbours of a voxel, given by its coordinates and index.
    fn each_at(&self, place: [usize; 3], voxel: usize, mut visit: impl FnMut(usize)) {
        if (0..3).all(|axis| place[axis] > 0 && place[axis] + 1 < self.size[axis]) {
            for (_, step) in &self.steps {
                visit(voxel.wrapping_add_signed(*step));
            }
            return;
        }
        for (delta, step) in &self.steps {
            let inside = |axis: usize| {
                place[axis].checked_add_signed(delta[axis]).is_some_and(|i| i < self.size[axis])
            };
            if (0..3).all(inside) {
                visit(voxel.wrapping_add_signed(*step));
            }
        }
    }

    /// Calls `visit` with the coordinates and index of each voxel, in parallel, and concatenates the
    /// results in the order of voxels.
    fn scan<T: Clone + Send>(&self, visit: impl Fn([usize; 3], usize, &mut Vec<T>) + Sync) -> Vec<T> {
        let [nx, ny, nz] = self.size;
        let layer = |z: usize| {
            let mut found = Vec::new();
            for y in 0..ny {
                for x in 0..nx {
                    visit([x, y, z], x + nx * (y + ny * z), &mut found);
                }
            }
            found
        };
        (0..nz).into_par_iter().map(layer).collect::<Vec<_>>().concat()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(values: &[f32], size: [usize; 3]) -> MergeTree {
        MergeTree::new(values.to_vec(), size, Connectivity::TwentySix)
    }

    fn random(seed: u64, size: [usize; 3], levels: u32) -> Vec<f32> {
        let mut random = fastrand::Rng::with_seed(seed);
        (0..size.iter().product()).map(|_| random.u32(0..levels) as f32).collect()
    }

    #[test]
    fn a_row_of_hills() {
        let tree = tree(&[0.0, 3.0, 1.0, 5.0, 2.0, 2.0, 4.0, 0.0, 1.0], [9, 1, 1]);
        let feature =
            |birth, death, birth_voxel, saddle_voxel| Feature { birth, death, birth_voxel, saddle_voxel };
        assert_eq!(
            tree.diagram(),
            [
                feature(5.0, 0.0, 3, None),
                feature(4.0, 2.0, 6, Some(5)),
                feature(3.0, 1.0, 1, Some(2)),
                feature(1.0, 0.0, 8, None),
            ]
        );
        assert_eq!(tree.basins_around(5).collect::<Vec<_>>(), [0]);
        assert_eq!(tree.basins_around(6).collect::<Vec<_>>(), [1, 0]);
        assert!(tree.basins_around(0).next().is_none());
        assert_eq!(tree.path(1, 2), [1]);
        assert_eq!(tree.path(1, 0), [1, 2, 3]);
    }

    #[test]
    fn diagonals_connect_with_26_but_not_with_6() {
        let mut values = vec![0.0; 8];
        (values[0], values[7]) = (2.0, 1.0);
        assert_eq!(tree(&values, [2, 2, 2]).diagram().len(), 1);
        assert_eq!(MergeTree::new(values, [2, 2, 2], Connectivity::Six).diagram().len(), 2);
    }

    #[test]
    fn ties_go_to_the_lower_index_and_plateaus_are_one_feature() {
        let tree = tree(&[2.0, 1.0, 2.0, 2.0, 1.0, 2.0], [6, 1, 1]);
        let diagram = tree.diagram();
        let places: Vec<_> = diagram.iter().map(|f| (f.birth_voxel, f.saddle_voxel)).collect();
        assert_eq!(places, [(0, None), (2, Some(1)), (5, Some(4))]);
    }

    #[test]
    fn empty_and_background() {
        assert_eq!(tree(&[], [0, 3, 4]).diagram(), []);
        assert_eq!(tree(&[0.0, -1.0, f32::NAN, 0.0], [4, 1, 1]).diagram(), []);
        let tree = tree(&[f32::INFINITY, 1.0], [2, 1, 1]);
        assert_eq!(tree.diagram()[0].persistence(), f32::INFINITY);
    }

    /// Counts the components of the superlevel sets by flood fill, at every level.
    #[test]
    fn betti_numbers_agree_with_flood_fill() {
        let size = [7, 6, 5];
        for (seed, levels) in [(1, 5), (2, 100), (3, 1000)] {
            for connectivity in [Connectivity::Six, Connectivity::TwentySix] {
                let values = random(seed, size, levels);
                let diagram = MergeTree::new(values.clone(), size, connectivity).diagram();
                let neighbours = Neighbours::new(size, connectivity);
                for level in 0..levels.min(40) {
                    let level = (level * levels.div_ceil(40).max(1)) as f32;
                    let mut seen: Vec<bool> = values.iter().map(|&value| value <= level).collect();
                    let mut components = 0;
                    for start in 0..values.len() {
                        if std::mem::replace(&mut seen[start], true) {
                            continue;
                        }
                        components += 1;
                        let mut edge = vec![start];
                        while let Some(voxel) = edge.pop() {
                            neighbours.each_at(neighbours.place(voxel), voxel, |n| {
                                if !std::mem::replace(&mut seen[n], true) {
                                    edge.push(n);
                                }
                            });
                        }
                    }
                    let alive = diagram.iter().filter(|f| f.birth > level && f.death <= level).count();
                    assert_eq!(alive, components, "seed {seed}, level {level}");
                }
            }
        }
    }

    /// A path is connected, contains its ends, and its lowest voxel is as high as possible: raising the
    /// threshold above it separates the ends.
    #[test]
    fn paths_are_connected_and_as_high_as_possible() {
        let size = [9, 8, 7];
        for seed in 0..6 {
            let values = random(seed, size, 60);
            let tree = tree(&values, size);
            let neighbours = Neighbours::new(size, Connectivity::TwentySix);
            let connects = |start: usize, end: usize, allowed: &dyn Fn(usize) -> bool| {
                let (mut seen, mut edge) = (vec![false; values.len()], vec![start]);
                seen[start] = true;
                while let Some(voxel) = edge.pop() {
                    neighbours.each_at(neighbours.place(voxel), voxel, |n| {
                        if allowed(n) && !std::mem::replace(&mut seen[n], true) {
                            edge.push(n);
                        }
                    });
                }
                seen[end]
            };
            let check = |start: usize, end: usize, path: &[usize]| {
                assert!(path.contains(&start) && path.contains(&end));
                assert!(connects(start, end, &|n| path.contains(&n)), "connected");
                let lowest = path.iter().map(|&v| values[v]).fold(f32::INFINITY, f32::min);
                let ends = values[start].min(values[end]);
                assert!(
                    lowest >= ends || !connects(start, end, &|n| values[n] > lowest),
                    "as high as possible"
                );
            };
            for voxel in (0..values.len()).step_by(5).filter(|&v| values[v] > 0.0) {
                for maximum in tree.basins_around(voxel) {
                    check(voxel, tree.feature(maximum).birth_voxel, &tree.path(voxel, maximum));
                }
            }
            for maximum in tree.persistent(0.0) {
                let Some(parent) = tree.parent(maximum) else { continue };
                let ends = [maximum, parent].map(|m| tree.feature(m).birth_voxel);
                check(ends[0], ends[1], &tree.path_over_saddle(maximum));
            }
        }
    }

    /// Stability theorem: the bottleneck distance is at most the largest change of a value.
    #[test]
    fn the_diagram_is_stable() {
        let size = [8, 8, 8];
        for seed in 0..5 {
            let values = random(seed, size, 400);
            let mut random = fastrand::Rng::with_seed(seed + 100);
            let most = 30.0;
            let changed: Vec<f32> = values.iter().map(|v| (v + random.f32() * most).max(0.0)).collect();
            let [a, b] = [values, changed].map(|v| tree(&v, size).diagram());
            let distance = bottleneck(&a, &b);
            assert!(distance <= most && distance > 0.0, "{distance}");
            // A uniform shift comes close to the bound.
            let shifted: Vec<f32> = random_shift(seed, size, 400, most);
            let shifted = bottleneck(&a, &tree(&shifted, size).diagram());
            assert!(shifted <= most && shifted > 0.9 * most, "{shifted}");
        }
    }

    fn random_shift(seed: u64, size: [usize; 3], levels: u32, by: f32) -> Vec<f32> {
        random(seed, size, levels).iter().map(|v| if *v > 0.0 { v + by } else { 0.0 }).collect()
    }

    /// Bottleneck distance: the least `d` for which a matching of both diagrams, diagonal included, exists
    /// within `d`.
    fn bottleneck(a: &[Feature], b: &[Feature]) -> f32 {
        let cost = |x: &Feature, y: &Feature| (x.birth - y.birth).abs().max((x.death - y.death).abs());
        let mut distances: Vec<f32> = a.iter().chain(b).map(|f| f.persistence() / 2.0).collect();
        distances.extend(a.iter().flat_map(|x| b.iter().map(move |y| cost(x, y))));
        distances.push(0.0);
        distances.sort_by(f32::total_cmp);
        let possible = |d: f32| covers(a, b, d, &cost) && covers(b, a, d, &cost);
        distances[distances.partition_point(|&d| !possible(d))]
    }

    /// Whether all points of `a` farther than `d` from the diagonal can be matched into `b` within `d`.
    /// Both directions together give a matching of both (Mendelsohn and Dulmage).
    fn covers(a: &[Feature], b: &[Feature], d: f32, cost: &dyn Fn(&Feature, &Feature) -> f32) -> bool {
        let mut partner = vec![None; b.len()];
        let far = (0..a.len()).filter(|&i| a[i].persistence() / 2.0 > d);
        far.into_iter().all(|i| augment(i, a, b, d, cost, &mut partner, &mut vec![false; b.len()]))
    }

    fn augment(
        i: usize,
        a: &[Feature],
        b: &[Feature],
        d: f32,
        cost: &dyn Fn(&Feature, &Feature) -> f32,
        partner: &mut Vec<Option<usize>>,
        tried: &mut Vec<bool>,
    ) -> bool {
        for j in 0..b.len() {
            if !tried[j] && cost(&a[i], &b[j]) <= d {
                tried[j] = true;
                if partner[j].is_none_or(|other| augment(other, a, b, d, cost, partner, tried)) {
                    partner[j] = Some(i);
                    return true;
                }
            }
        }
        false
    }

    #[test]
    fn a_grid_of_128_cubed_takes_well_under_a_second() {
        let n = 128;
        let mut random = fastrand::Rng::with_seed(1);
        let waves: Vec<[f32; 4]> = (0..12).map(|_| [0.0; 4].map(|_: f32| random.f32() * 0.6 - 0.3)).collect();
        let value = |i: usize| {
            let p = [i % n, i / n % n, i / n / n].map(|c| c as f32);
            let sum: f32 =
                waves.iter().map(|w| (w[0] * p[0] + w[1] * p[1] + w[2] * p[2] + 20.0 * w[3]).sin()).sum();
            20.0 + sum
        };
        let values: Vec<f32> = (0..n * n * n).map(value).collect();
        let start = std::time::Instant::now();
        let tree = MergeTree::new(values, [n; 3], Connectivity::TwentySix);
        let elapsed = start.elapsed().as_secs_f64();
        println!("128^3 voxels, {} features: {elapsed:.3} s", tree.diagram().len());
        assert!(tree.diagram().len() > 100);
        assert!(elapsed < 5.0, "{elapsed} s: far beyond what a busy machine explains");
    }
}
