//! Registers the op's backward with autodiff; no numerics here.

use burn::backend::autodiff::{
    Autodiff,
    checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
    grads::Gradients,
    ops::{Backward, Ops, OpsKind},
};
use burn::backend::tensor::FloatTensor;

use super::backward::{DenseTable, SdfFieldBackward};
use super::{SdfFieldConfig, SdfFieldOps};

#[derive(Debug)]
struct SdfField;

impl<B: SdfFieldBackward> Backward<B, 5> for SdfField {
    type State = B::Saved;

    fn backward(
        self,
        ops: Ops<Self::State, 5>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let grad = grads.consume::<B>(&ops.node);
        let [table, w1, b1, w2, b2] = ops.parents;
        let dense_table = match table {
            Some(_) => DenseTable::Wanted,
            None => DenseTable::Unwanted,
        };
        let found = B::sdf_field_backward(ops.state, grad, dense_table);
        let pairs = [
            (table, found.table),
            (w1, Some(found.w1)),
            (b1, Some(found.b1)),
            (w2, Some(found.w2)),
            (b2, Some(found.b2)),
        ];
        for (node, value) in pairs {
            if let (Some(node), Some(value)) = (node, value) {
                grads.register::<B>(node.id, value);
            }
        }
    }
}

impl<B: SdfFieldOps + SdfFieldBackward, C: CheckpointStrategy> SdfFieldOps for Autodiff<B, C> {
    fn sdf_field(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        w1: FloatTensor<Self>,
        b1: FloatTensor<Self>,
        w2: FloatTensor<Self>,
        b2: FloatTensor<Self>,
        config: SdfFieldConfig,
    ) -> FloatTensor<Self> {
        let points = points.into_primitive();
        let (table, table_node) = table.into_parts();
        let (w1, w1_node) = w1.into_parts();
        let (b1, b1_node) = b1.into_parts();
        let (w2, w2_node) = w2.into_parts();
        let (b2, b2_node) = b2.into_parts();
        let nodes = [table_node, w1_node, b1_node, w2_node, b2_node];
        match SdfField.prepare::<C>(nodes).compute_bound().stateful() {
            OpsKind::Tracked(prep) => {
                let (out, saved) = B::sdf_field_saving(points, table, w1, b1, w2, b2, config);
                prep.finish(saved, out)
            }
            OpsKind::UnTracked(prep) => {
                prep.finish(B::sdf_field(points, table, w1, b1, w2, b2, config))
            }
        }
    }
}
