//! [`Plan`]: the kernels of a step, one after the other, for the buffers that there are.

use shaders::fit::binding::{
    BLOCK_SUMS, BLURRED, COUNTS, D_PAIRS, D_PARAMETERS, D_PICTURE, DERIVATIVES, DIFFERENCES, FIRST_MOMENTS,
    KEYS, MEMORY, ORDER, PACE, PAIR_ROWS, PAIR_TILES, PARAMETERS, PHOTOGRAPH, PICTURE, ROWS, SECOND_MOMENTS,
    SERIES, SORTED_KEYS, SORTED_ROWS, SPLATS, STATE, STEP, TILE_PAIRS, TILE_STARTS,
};
use shaders::fit::layout::{Series, State};
use shaders::fit::{BLOCK, CHUNK, DIGIT_BITS, DIGITS, NO_DIGITS};

use super::buffers::{Fixed, Pair, Pairs, PerGaussian, PerPixel, Scanned};
use super::device::{Buffer, Device};
use super::kernels::{Dispatch, Kernels, Threads};
use crate::fit::backend::DeviceError;

/// Bits of a positive float, by which depths are sorted.
const DEPTH_BITS: u32 = 31;

/// The buffers of a fit.
pub(super) struct Buffers {
    pub(super) fixed: Fixed,
    pub(super) gaussians: PerGaussian,
    pub(super) pixels: PerPixel,
    pub(super) pairs: Pairs,
    pub(super) scanned: Scanned,
}

/// The kernels of a step.
pub(super) struct Plan {
    /// To the picture.
    pub(super) forward: Vec<Dispatch>,
    /// From there to the gradient by the picture.
    pub(super) loss: Vec<Dispatch>,
    /// From there to the gradient by the parameters.
    pub(super) backward: Vec<Dispatch>,
    /// The step along it.
    pub(super) adam: Dispatch,
}

impl Buffers {
    /// Rows of the splats that are drawn, front to back, once they are sorted.
    pub(super) fn order(&self) -> &Buffer {
        &self.gaussians.rows[passes(DEPTH_BITS) % 2]
    }
}

impl Plan {
    pub(super) fn new(device: &Device, kernels: &Kernels, buffers: &Buffers) -> Result<Plan, DeviceError> {
        let mut maker = Maker { device, kernels, buffers, series: Vec::new() };
        let forward = maker.forward()?;
        let (loss, backward, adam) = (maker.loss(), maker.backward(), maker.adam());
        Ok(Plan { forward, loss, backward, adam })
    }
}

/// Digits of numbers of so many bits.
fn passes(bits: u32) -> usize {
    bits.div_ceil(DIGIT_BITS) as usize
}

struct Maker<'a> {
    device: &'a Device,
    kernels: &'a Kernels,
    buffers: &'a Buffers,
    /// What the kernels that scan and sort are told. Who binds a buffer keeps it.
    series: Vec<Buffer>,
}

impl Maker<'_> {
    fn kernel(&self, name: &'static str, buffers: &[(u32, &Buffer)], threads: Threads) -> Dispatch {
        self.kernels.dispatch(self.device, name, buffers, threads)
    }

    fn series(&mut self, series: Series) -> Result<usize, DeviceError> {
        let buffer = self.device.uniform::<Series>()?;
        self.device.write(&buffer, 0, &[series]);
        self.series.push(buffer);
        Ok(self.series.len() - 1)
    }

    fn forward(&mut self) -> Result<Vec<Dispatch>, DeviceError> {
        let Buffers { fixed, gaussians, pixels, pairs, scanned } = self.buffers;
        let (step, state, order) = (&fixed.step, &fixed.state, self.buffers.order());
        let per_gaussian = Threads::Count(gaussians.count.into());
        let project = [
            (STEP, step),
            (PARAMETERS, &gaussians.parameters),
            (SPLATS, &gaussians.splats),
            (KEYS, &gaussians.keys[0]),
            (ROWS, &gaussians.rows[0]),
        ];
        let mut all = vec![self.kernel("project", &project, per_gaussian)];
        let by_depth = Sorted {
            bits: DEPTH_BITS,
            capacity: gaussians.count,
            // The first pass leaves out what is not drawn, and tells how many are left.
            lengths: [State::GAUSSIANS, State::DRAWN],
            total: State::DRAWN,
        };
        self.sort(&mut all, &gaussians.keys, &gaussians.rows, by_depth)?;

        let (splats, starts) = (&gaussians.splats, &pixels.tile_starts);
        let count = [(STATE, state), (SPLATS, splats), (COUNTS, &scanned.counts), (ORDER, order)];
        all.push(self.kernel("count_tiles", &count, per_gaussian));
        let of_pairs = self.series(Series {
            length_at: State::DRAWN,
            capacity: u32::MAX,
            total_at: State::PAIRS,
            shift: NO_DIGITS,
        })?;
        self.scan(&mut all, of_pairs, gaussians.count.into());
        let list = [
            (STEP, step),
            (STATE, state),
            (SPLATS, splats),
            (COUNTS, &scanned.counts),
            (BLOCK_SUMS, &scanned.block_sums),
            (ORDER, order),
            (PAIR_TILES, &pairs.tiles[0]),
            (PAIR_ROWS, &pairs.rows),
            (TILE_PAIRS, &pairs.numbers[0]),
        ];
        all.push(self.kernel("list_pairs", &list, per_gaussian));
        let by_tile = Sorted {
            // One number more than there are tiles.
            bits: u32::BITS - pixels.tiles.leading_zeros(),
            capacity: pairs.capacity,
            lengths: [State::PAIRS; 2],
            total: State::SPARE,
        };
        self.sort(&mut all, &pairs.tiles, &pairs.numbers, by_tile)?;
        let (tiles, numbers) = self.sorted_pairs();
        let find = [(STEP, step), (STATE, state), (PAIR_TILES, tiles), (TILE_STARTS, starts)];
        all.push(self.kernel("find_tiles", &find, Threads::TileStarts));
        let rasterize = [
            (STEP, step),
            (SPLATS, splats),
            (PAIR_ROWS, &pairs.rows),
            (TILE_PAIRS, numbers),
            (TILE_STARTS, starts),
            (PICTURE, &pixels.picture),
        ];
        all.push(self.kernel("rasterize", &rasterize, Threads::Tiles));
        Ok(all)
    }

    /// Tiles and numbers of the pairs, where they are once they are sorted.
    fn sorted_pairs(&self) -> (&Buffer, &Buffer) {
        let Buffers { pixels, pairs, .. } = self.buffers;
        let last = passes(u32::BITS - pixels.tiles.leading_zeros()) % 2;
        (&pairs.tiles[last], &pairs.numbers[last])
    }

    /// Sums up what is in the counts, of which there are at most so many.
    fn scan(&self, all: &mut Vec<Dispatch>, series: usize, most: u64) {
        let Buffers { fixed, scanned, .. } = self.buffers;
        let buffers = [
            (SERIES, &self.series[series]),
            (STATE, &fixed.state),
            (COUNTS, &scanned.counts),
            (BLOCK_SUMS, &scanned.block_sums),
        ];
        all.push(self.kernel("scan_blocks", &buffers, Threads::Count(most.div_ceil(u64::from(BLOCK)))));
        // The totals do not look at the counts themselves.
        all.push(self.kernel("scan_totals", &[buffers[0], buffers[1], buffers[3]], Threads::Group));
    }

    fn sort(
        &mut self,
        all: &mut Vec<Dispatch>,
        keys: &Pair,
        rows: &Pair,
        sorted: Sorted,
    ) -> Result<(), DeviceError> {
        let Buffers { fixed, scanned, .. } = self.buffers;
        let chunks = u64::from(sorted.capacity.div_ceil(CHUNK));
        for pass in 0..passes(sorted.bits) {
            let series = self.series(Series {
                length_at: sorted.lengths[pass.min(1)],
                capacity: sorted.capacity,
                total_at: sorted.total,
                shift: pass as u32 * DIGIT_BITS,
            })?;
            let (from, to) = (pass % 2, (pass + 1) % 2);
            let told = (SERIES, &self.series[series]);
            let state = (STATE, &fixed.state);
            let counts = (COUNTS, &scanned.counts);
            let count = [told, state, (KEYS, &keys[from]), counts];
            all.push(self.kernel("count_digits", &count, Threads::Count(chunks)));
            self.scan(all, series, u64::from(DIGITS) * chunks);
            let scatter = [
                told,
                state,
                (KEYS, &keys[from]),
                (ROWS, &rows[from]),
                (SORTED_KEYS, &keys[to]),
                (SORTED_ROWS, &rows[to]),
                counts,
                (BLOCK_SUMS, &scanned.block_sums),
            ];
            all.push(self.kernel("scatter", &scatter, Threads::Count(chunks)));
        }
        Ok(())
    }

    fn loss(&self) -> Vec<Dispatch> {
        let Buffers { fixed, pixels, .. } = self.buffers;
        let step = (STEP, &fixed.step);
        let (picture, photograph) = ((PICTURE, &pixels.picture), (PHOTOGRAPH, &pixels.photograph));
        let (blurred, derivatives) = ((BLURRED, &pixels.blurred), (DERIVATIVES, &pixels.derivatives));
        let differences = (DIFFERENCES, &pixels.differences);
        let gradient = (D_PICTURE, &pixels.d_picture);
        let compared = [step, picture, photograph, blurred, derivatives, differences];
        let backward = [step, picture, photograph, blurred, gradient];
        vec![
            self.kernel("blur_rows", &[step, picture, photograph, blurred], Threads::Pixels),
            self.kernel("compare", &compared, Threads::Pixels),
            self.kernel("blur_derivatives", &[step, blurred, derivatives], Threads::Pixels),
            self.kernel("loss_backward", &backward, Threads::Pixels),
            self.kernel("sum_loss", &[step, (STATE, &fixed.state), differences], Threads::Group),
        ]
    }

    fn backward(&self) -> Vec<Dispatch> {
        let Buffers { fixed, gaussians, pixels, pairs, .. } = self.buffers;
        let (step, splats) = ((STEP, &fixed.step), (SPLATS, &gaussians.splats));
        let sums = (D_PAIRS, &pairs.d_pairs);
        let rasterize_backward = [
            step,
            splats,
            (PAIR_ROWS, &pairs.rows),
            (TILE_PAIRS, self.sorted_pairs().1),
            (TILE_STARTS, &pixels.tile_starts),
            (PICTURE, &pixels.picture),
            (D_PICTURE, &pixels.d_picture),
            sums,
        ];
        let project_backward = [
            step,
            (STATE, &fixed.state),
            (PARAMETERS, &gaussians.parameters),
            (ORDER, self.buffers.order()),
            splats,
            sums,
            (D_PARAMETERS, &gaussians.d_parameters),
            (MEMORY, &gaussians.memory),
        ];
        let per_gaussian = Threads::Count(gaussians.count.into());
        vec![
            self.kernel("rasterize_backward", &rasterize_backward, Threads::Tiles),
            self.kernel("project_backward", &project_backward, per_gaussian),
        ]
    }

    fn adam(&self) -> Dispatch {
        let Buffers { fixed, gaussians, .. } = self.buffers;
        let adam = [
            (STEP, &fixed.step),
            (PACE, &fixed.pace),
            (STATE, &fixed.state),
            (PARAMETERS, &gaussians.parameters),
            (ORDER, self.buffers.order()),
            (D_PARAMETERS, &gaussians.d_parameters),
            (MEMORY, &gaussians.memory),
            (FIRST_MOMENTS, &gaussians.first_moments),
            (SECOND_MOMENTS, &gaussians.second_moments),
        ];
        let numbers = u64::from(gaussians.count) * u64::from(gaussians.columns.numbers());
        self.kernel("adam", &adam, Threads::Count(numbers))
    }
}

/// What is sorted.
#[derive(Clone, Copy)]
struct Sorted {
    /// By how many bits.
    bits: u32,
    /// Most that there are.
    capacity: u32,
    /// Which number of the state says how many there are: to the first pass, to the others.
    lengths: [u32; 2],
    /// Which number of the state the passes set to how many are left.
    total: u32,
}
