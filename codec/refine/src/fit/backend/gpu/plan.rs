//! [`Plan`]: the kernels of a step in order, bound to the current buffers.

use shaders::fit::binding::{
    ADAM_UNIFORMS, BLOCK_SUMS, BLURRED, COUNTS, D_CAMERA, D_IMAGE, D_PAIRS, D_PARAMETERS, D_VIEW,
    DERIVATIVES, DIFFERENCES, FIRST_MOMENTS, IMAGE, KEYS, ORDER, PAIR_ROWS, PAIR_TILES, PARAMETERS,
    PHOTOGRAPH, RESPONSE, ROWS, SECOND_MOMENTS, SEEN, SERIES, SORTED_KEYS, SORTED_ROWS, SPLATS, STATISTICS,
    TILE_PAIRS, TILE_STARTS, TOTALS, UNIFORMS,
};
use shaders::fit::layout::{Series, Totals};
use shaders::fit::{BLOCK, CHUNK, DIGIT_BITS, DIGITS, NO_DIGITS};

use super::buffers::{Buffers, DEPTH_BITS, PingPong, passes};
use super::device::{Buffer, Device};
use super::kernels::{Dispatch, Kernels, Threads};
use crate::fit::backend::DeviceError;

/// The kernels of a step.
pub(super) struct Plan {
    /// From parameters to the image.
    pub(super) forward: Vec<Dispatch>,
    /// From the image to what the camera shows of it; empty if cameras are not learned.
    pub(super) respond: Vec<Dispatch>,
    /// From there to its gradient.
    pub(super) loss: Vec<Dispatch>,
    /// From there to the gradients of the parameters and of the camera.
    pub(super) backward: Vec<Dispatch>,
    /// The step along that gradient.
    pub(super) adam: Dispatch,
}

impl Plan {
    pub(super) fn new(device: &Device, kernels: &Kernels, buffers: &Buffers) -> Result<Plan, DeviceError> {
        let builder = Builder { device, kernels, buffers };
        Ok(Plan {
            forward: builder.forward()?,
            respond: builder.respond(),
            loss: builder.loss(),
            backward: builder.backward(),
            adam: builder.adam(),
        })
    }
}

/// A sort of keys with their values.
#[derive(Clone, Copy)]
struct Sort {
    /// Significant bits of the keys.
    bits: u32,
    /// Largest number of keys.
    capacity: u32,
    /// Indices in the totals of the number of keys: for the first pass, for the others.
    lengths: [u32; 2],
    /// Index in the totals that receives the number of keys left after a pass.
    total: u32,
}

struct Builder<'a> {
    device: &'a Device,
    kernels: &'a Kernels,
    buffers: &'a Buffers,
}

impl Builder<'_> {
    fn kernel(&self, name: &'static str, buffers: &[(u32, &Buffer)], threads: Threads) -> Dispatch {
        self.kernels.dispatch(self.device, name, buffers, threads)
    }

    /// A buffer with `series`. The bind groups keep it alive.
    fn series(&self, series: Series) -> Result<Buffer, DeviceError> {
        let buffer = self.device.uniform::<Series>()?;
        self.device.write(&buffer, 0, &[series]);
        Ok(buffer)
    }

    fn forward(&self) -> Result<Vec<Dispatch>, DeviceError> {
        let mut plan = self.project_and_sort()?;
        self.bin(&mut plan)?;
        let Buffers { fixed, gaussians, pixels, pairs, .. } = self.buffers;
        let rasterize = [
            (UNIFORMS, &fixed.uniforms),
            (SPLATS, &gaussians.splats),
            (PAIR_ROWS, &pairs.rows),
            (TILE_PAIRS, self.sorted_pairs().1),
            (TILE_STARTS, &pixels.tile_starts),
            (IMAGE, &pixels.image),
        ];
        plan.push(self.kernel("rasterize", &rasterize, Threads::Tiles));
        Ok(plan)
    }

    fn project_and_sort(&self) -> Result<Vec<Dispatch>, DeviceError> {
        let Buffers { fixed, gaussians, .. } = self.buffers;
        let project = [
            (UNIFORMS, &fixed.uniforms),
            (PARAMETERS, &gaussians.parameters),
            (STATISTICS, &gaussians.statistics),
            (SPLATS, &gaussians.splats),
            (KEYS, &gaussians.keys[0]),
            (ROWS, &gaussians.rows[0]),
        ];
        let mut plan = vec![self.kernel("project", &project, Threads::Count(gaussians.count.into()))];
        let by_depth = Sort {
            bits: DEPTH_BITS,
            capacity: gaussians.count,
            // The first pass drops what is not drawn and counts the rest.
            lengths: [Totals::GAUSSIANS, Totals::DRAWN],
            total: Totals::DRAWN,
        };
        self.sort(&mut plan, &gaussians.keys, &gaussians.rows, by_depth)?;
        Ok(plan)
    }

    fn bin(&self, plan: &mut Vec<Dispatch>) -> Result<(), DeviceError> {
        let Buffers { fixed, gaussians, pixels, pairs, scanned } = self.buffers;
        let (uniforms, totals) = ((UNIFORMS, &fixed.uniforms), (TOTALS, &fixed.totals));
        let splats = (SPLATS, &gaussians.splats);
        let (counts, order) = ((COUNTS, &scanned.counts), (ORDER, self.buffers.order()));
        let per_gaussian = Threads::Count(gaussians.count.into());
        plan.push(self.kernel("count_tiles", &[totals, splats, counts, order], per_gaussian));
        let of_pairs = self.series(Series {
            length_at: Totals::DRAWN,
            capacity: u32::MAX,
            total_at: Totals::PAIRS,
            shift: NO_DIGITS,
        })?;
        self.scan(plan, &of_pairs, gaussians.count.into());
        let list = [
            uniforms,
            totals,
            splats,
            counts,
            (BLOCK_SUMS, &scanned.block_sums),
            order,
            (PAIR_TILES, &pairs.tiles[0]),
            (PAIR_ROWS, &pairs.rows),
            (TILE_PAIRS, &pairs.indices[0]),
        ];
        plan.push(self.kernel("list_pairs", &list, per_gaussian));
        let by_tile = Sort {
            bits: self.tile_bits(),
            capacity: pairs.capacity,
            lengths: [Totals::PAIRS; 2],
            total: Totals::SPARE,
        };
        self.sort(plan, &pairs.tiles, &pairs.indices, by_tile)?;
        let find =
            [uniforms, totals, (PAIR_TILES, self.sorted_pairs().0), (TILE_STARTS, &pixels.tile_starts)];
        plan.push(self.kernel("find_tiles", &find, Threads::TileStarts));
        Ok(())
    }

    /// Bits of a tile index, or of the number of tiles, which stands for no tile.
    fn tile_bits(&self) -> u32 {
        u32::BITS - self.buffers.pixels.tiles.leading_zeros()
    }

    /// Tiles and indices of the pairs after the sort by tile.
    fn sorted_pairs(&self) -> (&Buffer, &Buffer) {
        let pairs = &self.buffers.pairs;
        let last = passes(self.tile_bits()) % 2;
        (&pairs.tiles[last], &pairs.indices[last])
    }

    /// Scans the counts, at most `most`.
    fn scan(&self, plan: &mut Vec<Dispatch>, series: &Buffer, most: u64) {
        let Buffers { fixed, scanned, .. } = self.buffers;
        let buffers = [
            (SERIES, series),
            (TOTALS, &fixed.totals),
            (COUNTS, &scanned.counts),
            (BLOCK_SUMS, &scanned.block_sums),
        ];
        plan.push(self.kernel("scan_blocks", &buffers, Threads::Count(most.div_ceil(u64::from(BLOCK)))));
        // `scan_totals` does not use the counts.
        plan.push(self.kernel("scan_totals", &[buffers[0], buffers[1], buffers[3]], Threads::Group));
    }

    fn sort(
        &self,
        plan: &mut Vec<Dispatch>,
        keys: &PingPong,
        rows: &PingPong,
        sort: Sort,
    ) -> Result<(), DeviceError> {
        let Buffers { fixed, scanned, .. } = self.buffers;
        let chunks = u64::from(sort.capacity.div_ceil(CHUNK));
        for pass in 0..passes(sort.bits) {
            let series = self.series(Series {
                length_at: sort.lengths[pass.min(1)],
                capacity: sort.capacity,
                total_at: sort.total,
                shift: pass as u32 * DIGIT_BITS,
            })?;
            let (from, to) = (pass % 2, (pass + 1) % 2);
            let scatter = [
                (SERIES, &series),
                (TOTALS, &fixed.totals),
                (KEYS, &keys[from]),
                (COUNTS, &scanned.counts),
                (ROWS, &rows[from]),
                (SORTED_KEYS, &keys[to]),
                (SORTED_ROWS, &rows[to]),
                (BLOCK_SUMS, &scanned.block_sums),
            ];
            plan.push(self.kernel("count_digits", &scatter[..4], Threads::Count(chunks)));
            self.scan(plan, &series, u64::from(DIGITS) * chunks);
            plan.push(self.kernel("scatter", &scatter, Threads::Count(chunks)));
        }
        Ok(())
    }

    fn respond(&self) -> Vec<Dispatch> {
        if !self.kernels.columns.learns_cameras {
            return Vec::new();
        }
        let Buffers { fixed, pixels, .. } = self.buffers;
        let respond = [
            (UNIFORMS, &fixed.uniforms),
            (RESPONSE, &fixed.response),
            (IMAGE, &pixels.image),
            (SEEN, &pixels.seen),
        ];
        vec![self.kernel("respond", &respond, Threads::Pixels)]
    }

    fn loss(&self) -> Vec<Dispatch> {
        let Buffers { fixed, pixels, .. } = self.buffers;
        let seen = if self.kernels.columns.learns_cameras { &pixels.seen } else { &pixels.image };
        let uniforms = (UNIFORMS, &fixed.uniforms);
        let (image, photograph) = ((IMAGE, seen), (PHOTOGRAPH, &pixels.photograph));
        let (blurred, derivatives) = ((BLURRED, &pixels.blurred), (DERIVATIVES, &pixels.derivatives));
        let differences = (DIFFERENCES, &pixels.differences);
        let compare = [uniforms, image, photograph, blurred, derivatives, differences];
        let backward = [uniforms, image, photograph, blurred, (D_IMAGE, &pixels.d_image)];
        vec![
            self.kernel("blur_rows", &[uniforms, image, photograph, blurred], Threads::Pixels),
            self.kernel("compare", &compare, Threads::Pixels),
            self.kernel("blur_derivatives", &[uniforms, blurred, derivatives], Threads::Pixels),
            self.kernel("loss_backward", &backward, Threads::Pixels),
            self.kernel("sum_loss", &[uniforms, (TOTALS, &fixed.totals), differences], Threads::Group),
        ]
    }

    fn backward(&self) -> Vec<Dispatch> {
        let Buffers { fixed, gaussians, pixels, pairs, .. } = self.buffers;
        let (uniforms, splats) = ((UNIFORMS, &fixed.uniforms), (SPLATS, &gaussians.splats));
        let d_pairs = (D_PAIRS, &pairs.d_pairs);
        let rasterize_backward = [
            uniforms,
            splats,
            (PAIR_ROWS, &pairs.rows),
            (TILE_PAIRS, self.sorted_pairs().1),
            (TILE_STARTS, &pixels.tile_starts),
            (IMAGE, &pixels.image),
            (D_IMAGE, &pixels.d_image),
            d_pairs,
        ];
        let mut project_backward = vec![
            uniforms,
            (TOTALS, &fixed.totals),
            (PARAMETERS, &gaussians.parameters),
            (ORDER, self.buffers.order()),
            splats,
            d_pairs,
            (D_PARAMETERS, &gaussians.d_parameters),
            (STATISTICS, &gaussians.statistics),
        ];
        let learns_cameras = self.kernels.columns.learns_cameras;
        let mut plan = if learns_cameras { self.response_backward() } else { Vec::new() };
        let d_view = (D_VIEW, &gaussians.d_view);
        project_backward.extend(learns_cameras.then_some(d_view));
        let per_gaussian = Threads::Count(gaussians.count.into());
        plan.push(self.kernel("rasterize_backward", &rasterize_backward, Threads::Tiles));
        plan.push(self.kernel("project_backward", &project_backward, per_gaussian));
        if learns_cameras {
            let sum_view = [uniforms, (TOTALS, &fixed.totals), d_view, (D_CAMERA, &fixed.d_camera)];
            plan.push(self.kernel("sum_view", &sum_view, Threads::Group));
        }
        plan
    }

    /// From what the camera shows to the image.
    fn response_backward(&self) -> Vec<Dispatch> {
        let Buffers { fixed, pixels, .. } = self.buffers;
        let (uniforms, response) = ((UNIFORMS, &fixed.uniforms), (RESPONSE, &fixed.response));
        let d_image = (D_IMAGE, &pixels.d_image);
        let sum_response = [uniforms, response, (IMAGE, &pixels.image), d_image, (D_CAMERA, &fixed.d_camera)];
        vec![
            self.kernel("sum_response", &sum_response, Threads::Group),
            self.kernel("respond_backward", &[uniforms, response, d_image], Threads::Pixels),
        ]
    }

    fn adam(&self) -> Dispatch {
        let Buffers { fixed, gaussians, .. } = self.buffers;
        let adam = [
            (UNIFORMS, &fixed.uniforms),
            (ADAM_UNIFORMS, &fixed.adam_uniforms),
            (TOTALS, &fixed.totals),
            (PARAMETERS, &gaussians.parameters),
            (ORDER, self.buffers.order()),
            (D_PARAMETERS, &gaussians.d_parameters),
            (STATISTICS, &gaussians.statistics),
            (FIRST_MOMENTS, &gaussians.first_moments),
            (SECOND_MOMENTS, &gaussians.second_moments),
        ];
        let numbers = u64::from(gaussians.count) * u64::from(gaussians.columns.numbers());
        self.kernel("adam", &adam, Threads::Count(numbers))
    }
}
