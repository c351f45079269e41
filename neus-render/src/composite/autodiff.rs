//! Registration with Burn's autodiff: what is saved, and who computes the gradients.

use std::sync::Arc;

use burn::backend::{
    Autodiff, Backend,
    autodiff::{
        checkpoint::{base::Checkpointer, strategy::CheckpointStrategy},
        grads::Gradients,
        ops::{Backward, Ops, OpsKind},
    },
    tensor::FloatTensor,
};

use super::{CompositeConfig, CompositeOps, Packing};

/// Gradients of the three inputs, in their shapes.
pub struct CompositeGradients<B: Backend> {
    /// `[m_f, 6 or more]`.
    pub object: FloatTensor<B>,
    /// `[m_b, 5 or more]`.
    pub background: FloatTensor<B>,
    /// `[2]`.
    pub sharpness: FloatTensor<B>,
}

/// Backends that have the gradient kernel, too.
pub trait CompositeBackwardOps: CompositeOps {
    /// Gradients of the inputs (object, background, sharpness) from that of the pixels, `grad`
    /// `[rays, 20]`.
    fn composite_backward(
        inputs: [FloatTensor<Self>; 3],
        grad: FloatTensor<Self>,
        packing: Arc<Packing>,
        config: CompositeConfig,
    ) -> CompositeGradients<Self>;
}

#[derive(Debug)]
struct CompositeBackward;

#[derive(Clone, Debug)]
struct Saved<B: Backend> {
    inputs: [FloatTensor<B>; 3],
    packing: Arc<Packing>,
    config: CompositeConfig,
}

impl<B: CompositeBackwardOps> Backward<B, 3> for CompositeBackward {
    type State = Saved<B>;

    fn backward(
        self,
        ops: Ops<Self::State, 3>,
        grads: &mut Gradients,
        _checkpointer: &mut Checkpointer,
    ) {
        let grad = grads.consume::<B>(&ops.node);
        let saved = ops.state;
        let out = B::composite_backward(saved.inputs, grad, saved.packing, saved.config);
        let [object, background, sharpness] = ops.parents;
        for (parent, gradient) in [
            (object, out.object),
            (background, out.background),
            (sharpness, out.sharpness),
        ] {
            if let Some(node) = parent {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: CompositeBackwardOps, C: CheckpointStrategy> CompositeOps for Autodiff<B, C> {
    fn composite(
        object: FloatTensor<Self>,
        background: FloatTensor<Self>,
        sharpness: FloatTensor<Self>,
        packing: Arc<Packing>,
        config: CompositeConfig,
    ) -> FloatTensor<Self> {
        let (object, object_node) = object.into_parts();
        let (background, background_node) = background.into_parts();
        let (sharpness, sharpness_node) = sharpness.into_parts();
        let nodes = [object_node, background_node, sharpness_node];
        match CompositeBackward
            .prepare::<C>(nodes)
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prep) => {
                let out = B::composite(
                    object.clone(),
                    background.clone(),
                    sharpness.clone(),
                    packing.clone(),
                    config,
                );
                let saved = Saved {
                    inputs: [object, background, sharpness],
                    packing,
                    config,
                };
                prep.finish(saved, out)
            }
            OpsKind::UnTracked(prep) => {
                prep.finish(B::composite(object, background, sharpness, packing, config))
            }
        }
    }
}
