//! [`Plan`]: the kernels of a step in order, bound to the current buffers.

use shaders::fit::DIGIT_BITS;
use shaders::fit::binding::{
    ADAM_UNIFORMS, BLOCK_SUMS, COUNTS, D_CAMERA, D_IMAGE, D_PAIRS, D_PARAMETERS, DERIVATIVES, FIRST_MOMENTS,
    IMAGE, KEYS, ORDER, PAIR_ROWS, PAIR_TILES, PARAMETERS, PHOTOGRAPH, RESPONSE, ROWS, SECOND_MOMENTS,
    SERIES, SORTED_KEYS, SORTED_ROWS, SPLATS, STATISTICS, TILE_PAIRS, TILE_STARTS, TILE_SUMS, TOTALS,
    UNIFORMS, VIEW_SUMS,
};
use shaders::fit::layout::{Series, Totals};

use super::buffers::{Buffers, DEPTH_BITS, PingPong, passes};
use super::device::{Buffer, Device};
use super::kernels::{Dispatch, Kernels, Threads};
use crate::fit::backend::DeviceError;

/// The kernels of a step.
pub(super) struct Plan {
    /// From parameters to the image.
    pub(super) forward: Vec<StepPart>,
    /// From the image to its gradient.
    pub(super) loss: Vec<StepPart>,
    /// From there to the gradients of the parameters and of the camera.
    pub(super) backward: Vec<StepPart>,
    /// The step along that gradient.
    pub(super) adam: Vec<StepPart>,
}

/// A part of a step.
pub(super) struct StepPart {
    pub(super) name: &'static str,
    pub(super) dispatches: Vec<Dispatch>,
}

impl Plan {
    pub(super) fn new(device: &Device, kernels: &Kernels, buffers: &Buffers) -> Result<Plan, DeviceError> {
        let builder = Builder { device, kernels, buffers };
        Ok(Plan {
            forward: builder.forward()?,
            loss: vec![builder.loss()],
            backward: builder.backward(),
            adam: vec![builder.adam()],
        })
    }

    /// The parts of a whole step, in order.
    pub(super) fn step(&self) -> [&[StepPart]; 4] {
        let Plan { forward, loss, backward, adam } = self;
        [forward, loss, backward, adam]
    }
}

impl StepPart {
    fn new(name: &'static str, dispatches: Vec<Dispatch>) -> StepPart {
        StepPart { name, dispatches }
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
    /// Index in the totals that receives the number of keys left after the first pass.
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

    fn forward(&self) -> Result<Vec<StepPart>, DeviceError> {
        let Buffers { fixed, gaussians, pixels, pairs, .. } = self.buffers;
        let rasterize = [
            (UNIFORMS, &fixed.uniforms),
            (SPLATS, &gaussians.splats),
            (PAIR_ROWS, &pairs.rows),
            (TILE_PAIRS, self.sorted_pairs().1),
            (TILE_STARTS, &pixels.tile_starts),
            (IMAGE, &pixels.image),
        ];
        Ok(vec![
            self.project(),
            StepPart::new("sort", self.sort_by_depth()?),
            StepPart::new("bin", self.bin()?),
            StepPart::new("rasterize", vec![self.kernel("rasterize", &rasterize, Threads::Tiles)]),
        ])
    }

    fn project(&self) -> StepPart {
        let Buffers { fixed, gaussians, .. } = self.buffers;
        let project = [
            (UNIFORMS, &fixed.uniforms),
            (PARAMETERS, &gaussians.parameters),
            (STATISTICS, &gaussians.statistics),
            (SPLATS, &gaussians.splats),
            (KEYS, &gaussians.keys[0]),
            (ROWS, &gaussians.rows[0]),
        ];
        let per_gaussian = Threads::Count(gaussians.count.into());
        StepPart::new("project", vec![self.kernel("project", &project, per_gaussian)])
    }

    fn sort_by_depth(&self) -> Result<Vec<Dispatch>, DeviceError> {
        let gaussians = &self.buffers.gaussians;
        let by_depth = Sort {
            bits: DEPTH_BITS,
            capacity: gaussians.count,
            // The first pass drops what is not drawn and counts the rest.
            lengths: [Totals::GAUSSIANS, Totals::DRAWN],
            total: Totals::DRAWN,
        };
        self.sorted(&gaussians.keys, &gaussians.rows, by_depth)
    }

    fn bin(&self) -> Result<Vec<Dispatch>, DeviceError> {
        let Buffers { fixed, gaussians, pixels, pairs } = self.buffers;
        let (uniforms, totals) = ((UNIFORMS, &fixed.uniforms), (TOTALS, &fixed.totals));
        let count = [
            totals,
            (SPLATS, &gaussians.splats),
            (BLOCK_SUMS, &gaussians.block_sums),
            (ORDER, self.buffers.order()),
        ];
        let list = [
            uniforms,
            count[0],
            count[1],
            count[2],
            count[3],
            (D_PAIRS, &pairs.d_pairs),
            (PAIR_TILES, &pairs.tiles[0]),
            (PAIR_ROWS, &pairs.rows),
            (TILE_PAIRS, &pairs.indices[0]),
        ];
        let mut plan = vec![
            self.kernel("count_tiles", &count, Threads::Blocks(gaussians.count)),
            self.kernel("list_pairs", &list, Threads::Blocks(gaussians.count)),
        ];
        let by_tile = Sort {
            bits: self.buffers.tile_bits(),
            capacity: pairs.capacity,
            lengths: [Totals::PAIRS; 2],
            total: Totals::SPARE,
        };
        plan.extend(self.sorted(&pairs.tiles, &pairs.indices, by_tile)?);
        let find =
            [uniforms, totals, (PAIR_TILES, self.sorted_pairs().0), (TILE_STARTS, &pixels.tile_starts)];
        plan.push(self.kernel("find_tiles", &find, Threads::TileStarts));
        Ok(plan)
    }

    /// Tiles and indices of the pairs after the sort by tile.
    fn sorted_pairs(&self) -> (&Buffer, &Buffer) {
        let pairs = &self.buffers.pairs;
        let last = passes(self.buffers.tile_bits()) % 2;
        (&pairs.tiles[last], &pairs.indices[last])
    }

    fn sorted(&self, keys: &PingPong, rows: &PingPong, sort: Sort) -> Result<Vec<Dispatch>, DeviceError> {
        let mut plan = Vec::new();
        let Buffers { fixed, .. } = self.buffers;
        for pass in 0..passes(sort.bits) {
            let series = self.series(Series {
                length_at: sort.lengths[pass.min(1)],
                capacity: sort.capacity,
                total_at: if pass == 0 { sort.total } else { Totals::SPARE },
                shift: pass as u32 * DIGIT_BITS,
            })?;
            let (from, to) = (pass % 2, (pass + 1) % 2);
            let scatter = [
                (SERIES, &series),
                (TOTALS, &fixed.totals),
                (KEYS, &keys[from]),
                (COUNTS, &fixed.counts),
                (ROWS, &rows[from]),
                (SORTED_KEYS, &keys[to]),
                (SORTED_ROWS, &rows[to]),
            ];
            plan.push(self.kernel("count_digits", &scatter[..4], Threads::Parts(sort.capacity)));
            plan.push(self.kernel("scatter", &scatter, Threads::Parts(sort.capacity)));
        }
        Ok(plan)
    }

    fn loss(&self) -> StepPart {
        let Buffers { fixed, pixels, .. } = self.buffers;
        let buffers = [
            (UNIFORMS, &fixed.uniforms),
            (RESPONSE, &fixed.response),
            (IMAGE, &pixels.image),
            (PHOTOGRAPH, &pixels.photograph),
            (DERIVATIVES, &pixels.derivatives),
            (TILE_SUMS, &pixels.tile_sums),
            (D_IMAGE, &pixels.d_image),
        ];
        let kernels = vec![
            self.kernel("compare", &buffers[..6], Threads::Tiles),
            self.kernel("loss_backward", &buffers, Threads::Tiles),
        ];
        StepPart::new("loss", kernels)
    }

    fn backward(&self) -> Vec<StepPart> {
        let Buffers { fixed, gaussians, pixels, pairs, .. } = self.buffers;
        let (uniforms, splats) = ((UNIFORMS, &fixed.uniforms), (SPLATS, &gaussians.splats));
        let (totals, d_pairs) = ((TOTALS, &fixed.totals), (D_PAIRS, &pairs.d_pairs));
        let view_sums = (VIEW_SUMS, &gaussians.view_sums);
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
        let project_backward = [
            uniforms,
            totals,
            (PARAMETERS, &gaussians.parameters),
            (ORDER, self.buffers.order()),
            splats,
            d_pairs,
            (D_PARAMETERS, &gaussians.d_parameters),
            (STATISTICS, &gaussians.statistics),
            view_sums,
        ];
        let sum_step =
            [uniforms, totals, (TILE_SUMS, &pixels.tile_sums), view_sums, (D_CAMERA, &fixed.d_camera)];
        let per_gaussian = Threads::Count(gaussians.count.into());
        [
            ("rasterize_backward", self.kernel("rasterize_backward", &rasterize_backward, Threads::Tiles)),
            ("project_backward", self.kernel("project_backward", &project_backward, per_gaussian)),
            ("sum", self.kernel("sum_step", &sum_step, Threads::Group)),
        ]
        .map(|(name, dispatch)| StepPart::new(name, vec![dispatch]))
        .into()
    }

    fn adam(&self) -> StepPart {
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
        StepPart::new("adam", vec![self.kernel("adam", &adam, Threads::Strided(numbers))])
    }
}
