//! Registers the op's backward with autodiff; no numerics here.

use burn::backend::autodiff::{
    Autodiff,
    checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
    grads::Gradients,
    ops::{Backward, Ops, OpsKind},
};
use burn::backend::tensor::FloatTensor;

use super::backward::ColourFieldBackward;
use super::{ColourFieldOps, Output};

#[derive(Debug)]
struct ColourField;

impl<B: ColourFieldBackward> Backward<B, 7> for ColourField {
    type State = B::Saved;

    fn backward(
        self,
        ops: Ops<Self::State, 7>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let grad = grads.consume::<B>(&ops.node);
        let found = B::colour_field_backward(ops.state, grad);
        for (node, value) in ops.parents.into_iter().zip(found) {
            if let Some(node) = node {
                grads.register::<B>(node.id, value);
            }
        }
    }
}

impl<B: ColourFieldOps + ColourFieldBackward, C: CheckpointStrategy> ColourFieldOps
    for Autodiff<B, C>
{
    fn colour_field(
        geometry: FloatTensor<Self>,
        points: FloatTensor<Self>,
        directions: FloatTensor<Self>,
        extra: FloatTensor<Self>,
        stretch: FloatTensor<Self>,
        w1: FloatTensor<Self>,
        b1: FloatTensor<Self>,
        w2: FloatTensor<Self>,
        b2: FloatTensor<Self>,
        w3: FloatTensor<Self>,
        b3: FloatTensor<Self>,
        output: Output,
    ) -> FloatTensor<Self> {
        let tracked = [geometry, w1, b1, w2, b2, w3, b3].map(|tensor| tensor.into_parts());
        let constants = [points, directions, extra, stretch].map(|tensor| tensor.into_primitive());
        let [points, directions, extra, stretch] = constants;
        let mut nodes = Vec::with_capacity(7);
        let mut values = Vec::with_capacity(7);
        for (value, node) in tracked {
            values.push(value);
            nodes.push(node);
        }
        let (Ok(nodes), Ok(values)) = (<[_; 7]>::try_from(nodes), <[_; 7]>::try_from(values))
        else {
            unreachable!("seven tensors went in");
        };
        let [geometry, w1, b1, w2, b2, w3, b3] = values;
        match ColourField.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let arguments = [
                    geometry, points, directions, extra, stretch, w1, b1, w2, b2, w3, b3,
                ];
                let (out, saved) = B::colour_field_saving(arguments, output);
                prep.finish(saved, out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::colour_field(
                geometry, points, directions, extra, stretch, w1, b1, w2, b2, w3, b3, output,
            )),
        }
    }
}
