//! Registration with Burn's autodiff: what is saved, and who computes the gradient.

use burn::backend::{
    Autodiff, Backend,
    autodiff::{
        checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
        grads::Gradients,
        ops::{Backward, Ops, OpsKind},
    },
    tensor::FloatTensor,
};

use super::{RowLossesOps, RowTerm};

/// Backends that have the gradient kernel, too.
pub trait RowLossesBackwardOps: RowLossesOps {
    /// The gradient of the rows for `grad [terms]`.
    fn row_losses_backward(
        rows: FloatTensor<Self>,
        known: FloatTensor<Self>,
        terms: &[RowTerm],
        grad: FloatTensor<Self>,
    ) -> FloatTensor<Self>;
}

#[derive(Debug)]
struct RowLossesBackward;

#[derive(Clone, Debug)]
struct Saved<B: Backend> {
    rows: FloatTensor<B>,
    known: FloatTensor<B>,
    terms: Vec<RowTerm>,
}

impl<B: RowLossesBackwardOps> Backward<B, 1> for RowLossesBackward {
    type State = Saved<B>;

    fn backward(
        self,
        ops: Ops<Self::State, 1>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let grad = grads.consume::<B>(&ops.node);
        let Saved { rows, known, terms } = ops.state;
        let [parent] = ops.parents;
        if let Some(node) = parent {
            let gradient = B::row_losses_backward(rows, known, &terms, grad);
            grads.register::<B>(node.id, gradient);
        }
    }
}

impl<B: RowLossesBackwardOps, C: CheckpointStrategy> RowLossesOps for Autodiff<B, C> {
    fn row_losses(
        rows: FloatTensor<Self>,
        known: FloatTensor<Self>,
        terms: Vec<RowTerm>,
    ) -> FloatTensor<Self> {
        let (rows, node) = rows.into_parts();
        let (known, _) = known.into_parts();
        match RowLossesBackward
            .prepare::<C>([node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::row_losses(rows.clone(), known.clone(), terms.clone());
                prep.finish(Saved { rows, known, terms }, out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::row_losses(rows, known, terms)),
        }
    }
}
