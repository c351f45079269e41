//! Registers the ops' backward with autodiff; no numerics here.

use burn::backend::autodiff::{
    Autodiff,
    checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
    grads::Gradients,
    ops::{Backward, Ops, OpsKind},
};
use burn::backend::tensor::FloatTensor;

use super::backward::EncodeBackward;
use super::{EncodeConfig, EncodeOps};

#[derive(Debug)]
struct Encode;

impl<B: EncodeBackward> Backward<B, 2> for Encode {
    type State = (FloatTensor<B>, FloatTensor<B>, EncodeConfig);

    fn backward(
        self,
        ops: Ops<Self::State, 2>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let grad = grads.consume::<B>(&ops.node);
        let (points, table, config) = ops.state;
        let [points_node, table_node] = ops.parents;
        if let Some(node) = points_node {
            let (points, grad) = (points.clone(), grad.clone());
            let out = B::hash_encode_points_gradient(points, table, grad, &config);
            grads.register::<B>(node.id, out);
        }
        if let Some(node) = table_node {
            grads.register::<B>(
                node.id,
                B::hash_encode_table_gradient(points, grad, &config),
            );
        }
    }
}

#[derive(Debug)]
struct EncodeWithJacobian;

impl<B: EncodeBackward> Backward<B, 1> for EncodeWithJacobian {
    type State = (FloatTensor<B>, EncodeConfig);

    fn backward(
        self,
        ops: Ops<Self::State, 1>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let grad = grads.consume::<B>(&ops.node);
        let (points, config) = ops.state;
        if let [Some(node)] = ops.parents {
            grads.register::<B>(
                node.id,
                B::hash_encode_table_gradient(points, grad, &config),
            );
        }
    }
}

impl<B: EncodeOps + EncodeBackward, C: CheckpointStrategy> EncodeOps for Autodiff<B, C> {
    fn hash_encode(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        config: EncodeConfig,
    ) -> FloatTensor<Self> {
        let (points, points_node) = points.into_parts();
        let (table, table_node) = table.into_parts();
        match Encode
            .prepare::<C>([points_node, table_node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::hash_encode(points.clone(), table.clone(), config.clone());
                prep.finish((points, table, config), out)
            }
            OpsKind::UnTracked(prep) => prep.finish(B::hash_encode(points, table, config)),
        }
    }

    fn hash_encode_with_jacobian(
        points: FloatTensor<Self>,
        table: FloatTensor<Self>,
        config: EncodeConfig,
    ) -> FloatTensor<Self> {
        let points = points.into_primitive();
        let (table, table_node) = table.into_parts();
        match EncodeWithJacobian
            .prepare::<C>([table_node])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::hash_encode_with_jacobian(points.clone(), table, config.clone());
                prep.finish((points, config), out)
            }
            OpsKind::UnTracked(prep) => {
                prep.finish(B::hash_encode_with_jacobian(points, table, config))
            }
        }
    }
}
