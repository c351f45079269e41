//! A layer of a network at many points.
//!
//! One thread takes eight outputs at eight points: 16 numbers read for 64 multiplications, where a thread
//! that takes one point reads two for each. Where it reads them is what [`WeightReads`] says.

mod kernels;
mod weight_reads;

use std::sync::OnceLock;

use burn_cubecl::cubecl::client::Client;
use burn_cubecl::tensor::CubeTensor;

use crate::points::{BLOCK, LANES, PointMatrix, padded};
use crate::tensor::{UNITS, buffer, fresh, units_for};
use kernels::{Activation, Tile, dense_kernel, pack_kernel, tiled_kernel};
pub use weight_reads::WeightReads;

/// A layer, or the way back through it.
#[derive(Clone, Debug)]
pub struct Packed {
    weight: CubeTensor,
    bias: Option<CubeTensor>,
    inputs: usize,
    outputs: usize,
    reads: Option<WeightReads>,
    /// See [`Packed::rows`].
    rows: OnceLock<CubeTensor>,
}

impl Packed {
    /// Of a layer `[outputs, inputs]` with its bias, which is the weight of one more input.
    ///
    /// # Panics
    /// When the layer has no outputs or no inputs, or the bias is not one for each output.
    #[must_use]
    pub fn forward(weight: &CubeTensor, bias: &CubeTensor) -> Self {
        let (outputs, inputs) = sizes(weight);
        assert_eq!(
            bias.meta.shape().num_elements(),
            outputs,
            "Packed: values of the bias and outputs of the layer"
        );
        Self::new(weight, Some(bias), inputs + 1, outputs)
    }

    /// Of the way back through a layer `[outputs, inputs]`: from its outputs' gradients to its inputs'.
    ///
    /// # Panics
    /// When the layer has no outputs or no inputs.
    #[must_use]
    pub fn backward(weight: &CubeTensor) -> Self {
        let (outputs, inputs) = sizes(weight);
        Self::new(weight, None, outputs, inputs)
    }

    fn new(weight: &CubeTensor, bias: Option<&CubeTensor>, inputs: usize, outputs: usize) -> Self {
        Self {
            weight: weight.clone(),
            bias: bias.cloned(),
            inputs,
            outputs,
            reads: None,
            rows: OnceLock::new(),
        }
    }

    /// The weights as threads read them by themselves: a row of all outputs for each input, padded to whole blocks.
    fn rows(&self) -> &CubeTensor {
        self.rows.get_or_init(|| {
            let rows = fresh(&self.weight, [self.inputs, padded(self.outputs)]);
            let (count, dim) = units_for(&rows.client, self.inputs * padded(self.outputs));
            // SAFETY: threads beyond the entries return at once, and weights are read where they exist.
            unsafe {
                pack_kernel::launch_unchecked(
                    &rows.client,
                    count,
                    dim,
                    buffer(&self.weight),
                    buffer(self.bias.as_ref().unwrap_or(&self.weight)),
                    buffer(&rows),
                    self.inputs,
                    self.outputs,
                    self.bias.is_some(),
                );
            }
            rows
        })
    }

    /// The same, reading its weights there instead of where [`WeightReads::faster`] says.
    #[must_use]
    pub fn reading(mut self, reads: WeightReads) -> Self {
        self.reads = Some(reads);
        self
    }

    /// The layer without an activation.
    ///
    /// # Panics
    /// When `x` does not have a row for each of the layer's inputs, of which the bias' is the last, or its data do not have
    /// what rows and points promise.
    #[must_use]
    pub fn apply(&self, x: &PointMatrix) -> PointMatrix {
        self.apply_to(x, x.points)
    }

    /// The same at the first `points` of `x` alone, a multiple of [`BLOCK`].
    ///
    /// # Panics
    /// As [`Packed::apply`], and when there are not so many points or they are no such multiple.
    #[must_use]
    pub fn apply_to(&self, x: &PointMatrix, points: usize) -> PointMatrix {
        expect_part("points", points, x.points);
        let y = PointMatrix::fresh(&x.data, self.outputs, points);
        self.launch(x, &y, None, Activation::Linear, self.all());
        y
    }

    /// The same where all rows of `x` from `inputs` on are zero, but the bias'.
    ///
    /// # Panics
    /// As [`Packed::apply`], and when there are not so many inputs besides the last one.
    #[must_use]
    pub fn apply_first(&self, x: &PointMatrix, inputs: usize) -> PointMatrix {
        expect_part("inputs before the last one", inputs, self.inputs - 1);
        let y = PointMatrix::fresh(&x.data, self.outputs, x.points);
        let used = Used {
            inputs,
            ..self.all()
        };
        self.launch(x, &y, None, Activation::Linear, used);
        y
    }

    /// The first `outputs` of the layer; what the other rows hold is arbitrary.
    ///
    /// # Panics
    /// As [`Packed::apply`], and when there are not so many outputs.
    #[must_use]
    pub fn first_outputs(&self, x: &PointMatrix, outputs: usize) -> PointMatrix {
        expect_part("outputs", outputs, self.outputs);
        let y = PointMatrix::fresh(&x.data, self.outputs, x.points);
        let used = Used {
            outputs,
            ..self.all()
        };
        self.launch(x, &y, None, Activation::Linear, used);
        y
    }

    fn all(&self) -> Used {
        Used {
            inputs: self.inputs - 1,
            outputs: self.outputs,
        }
    }

    /// The layer and a ReLU, and below its outputs a row of ones: the input of the next layer's bias.
    ///
    /// # Panics
    /// As [`Packed::apply`].
    #[must_use]
    pub fn relu(&self, x: &PointMatrix) -> PointMatrix {
        let y = PointMatrix::fresh(&x.data, self.outputs + 1, x.points);
        self.launch(x, &y, None, Activation::ReluAndOne, self.all());
        y
    }

    /// The layer, zero where `gate` is: the way back through a ReLU whose result that was. Rows of it below the layer's outputs
    /// do not matter.
    ///
    /// # Panics
    /// As [`Packed::apply`], and when `gate` has fewer rows than the layer has outputs, is of other points than `x`, or its data
    /// do not have what rows and points promise.
    #[must_use]
    pub fn gated(&self, x: &PointMatrix, gate: &PointMatrix) -> PointMatrix {
        gate.expect_whole("Packed");
        expect_part("outputs", self.outputs, gate.rows);
        assert_eq!(gate.points, x.points, "Packed: points of the gate");
        let y = PointMatrix::fresh(&x.data, self.outputs, x.points);
        self.launch(x, &y, Some(gate), Activation::Gated, self.all());
        y
    }

    fn launch(
        &self,
        x: &PointMatrix,
        y: &PointMatrix,
        gate: Option<&PointMatrix>,
        activation: Activation,
        used: Used,
    ) {
        assert_eq!(
            self.inputs, x.rows,
            "Packed: inputs of the layer and rows of the matrix"
        );
        x.expect_whole("Packed");
        if y.points == 0 {
            return;
        }
        let reads = self.reads.unwrap_or_else(|| WeightReads::faster(&y.data));
        let tile = Tile::of(self.outputs);
        if reads == WeightReads::Shared && tile.bytes() <= shared_memory(&y.data.client) {
            self.launch_tiles(x, y, gate, activation, used, tile);
        } else {
            self.launch_threads(x, y, gate, activation, used);
        }
    }

    fn launch_threads(
        &self,
        x: &PointMatrix,
        y: &PointMatrix,
        gate: Option<&PointMatrix>,
        activation: Activation,
        used: Used,
    ) {
        let blocks = y.points / BLOCK;
        let client = &y.data.client;
        let (count, dim) = units_for(client, blocks * (padded(used.outputs) / BLOCK));
        // SAFETY: threads beyond the blocks write nothing; matrices are padded to whole blocks.
        unsafe {
            dense_kernel::launch_unchecked(
                client,
                count,
                dim,
                buffer(self.rows()),
                buffer(&x.data),
                buffer(&gate.unwrap_or(x).data),
                buffer(&y.data),
                blocks as u32,
                used.inputs as u32,
                (x.points / LANES) as u32,
                self.inputs,
                self.outputs,
                activation,
            );
        }
    }

    fn launch_tiles(
        &self,
        x: &PointMatrix,
        y: &PointMatrix,
        gate: Option<&PointMatrix>,
        activation: Activation,
        used: Used,
        tile: Tile,
    ) {
        let blocks = y.points / BLOCK;
        let groups = blocks.div_ceil(tile.points);
        let tiles = (padded(used.outputs) / BLOCK).div_ceil(tile.outputs);
        let client = &y.data.client;
        let (count, dim) = units_for(client, groups * tiles * UNITS as usize);
        // SAFETY: threads beyond the tiles write nothing; matrices are padded to whole blocks.
        unsafe {
            tiled_kernel::launch_unchecked(
                client,
                count,
                dim,
                buffer(&self.weight),
                buffer(self.bias.as_ref().unwrap_or(&self.weight)),
                buffer(&x.data),
                buffer(&gate.unwrap_or(x).data),
                buffer(&y.data),
                blocks as u32,
                used.inputs as u32,
                (x.points / LANES) as u32,
                self.inputs,
                self.outputs,
                self.bias.is_some(),
                activation,
                tile,
            );
        }
    }
}

/// Outputs and inputs of a layer `[outputs, inputs]`. Kernels read the last weight in place of one that is not there, so
/// there must be one.
fn sizes(weight: &CubeTensor) -> (usize, usize) {
    let shape = weight.meta.shape();
    let (outputs, inputs) = (shape[0], shape[1]);
    assert!(
        outputs > 0 && inputs > 0,
        "Packed: a layer {shape:?} without outputs or inputs"
    );
    (outputs, inputs)
}

/// Panics unless there are at least so many of `what`.
fn expect_part(what: &str, wanted: usize, there: usize) {
    assert!(wanted <= there, "Packed: {wanted} {what}, of {there}");
}

/// Bytes that a workgroup's threads may share.
fn shared_memory(client: &Client) -> usize {
    client.properties().hardware.max_shared_memory_size
}

/// How much of a layer is wanted.
#[derive(Clone, Copy, Debug)]
struct Used {
    /// Leading inputs, before the last one, which always counts.
    inputs: usize,
    /// Leading outputs.
    outputs: usize,
}
