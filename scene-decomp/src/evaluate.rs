//! A trained surface as plain slices, for renders and meshes: no tensors, no gradients.

use std::sync::Arc;

use hashgrid::GridLayout;

use crate::colour_field;
use crate::sdf_field::{self, SdfFieldConfig};
use crate::surface::Surface;

/// A copy of a surface's weights that answers for points without autodiff.
#[derive(Clone, Debug)]
pub struct FrozenSurface {
    table: Vec<f32>,
    sdf: sdf_field::Weights,
    colour: colour_field::Weights,
    config: SdfFieldConfig,
    columns: usize,
}

/// Rows of [`FrozenSurface::geometry`].
#[derive(Clone, Debug, Default)]
pub struct Geometry {
    /// `[n, columns]`: sdf, features, normal.
    pub values: Vec<f32>,
    /// Columns of `values`.
    pub columns: usize,
}

impl Geometry {
    /// Signed distance of point `i`.
    #[must_use]
    pub fn sdf(&self, i: usize) -> f32 {
        self.values[i * self.columns]
    }

    /// Normal of point `i`: the sdf's gradient, not normalised.
    #[must_use]
    pub fn normal(&self, i: usize) -> glam::Vec3 {
        let end = (i + 1) * self.columns;
        glam::Vec3::from_slice(&self.values[end - 3..end])
    }
}

impl FrozenSurface {
    /// Copies the weights of `surface`, of which `active_levels` are in use.
    ///
    /// # Panics
    /// When a weight is not of type `f32`.
    #[must_use]
    pub fn new(surface: &Surface, layout: &Arc<GridLayout>, active_levels: usize) -> Self {
        let config = surface.sdf_config(layout, active_levels, None);
        let s = surface.sdf_weights();
        let c = surface.colour_weights();
        let columns = s.b2.dims()[0] + 3;
        let (w1, b1, w2, b2) = (values(s.w1), values(s.b1), values(s.w2), values(s.b2));
        Self {
            table: values(s.table),
            sdf: sdf_field::Weights::new(&config, &w1, &b1, &w2, &b2),
            colour: colour_field::Weights::new([
                &values(c.w1),
                &values(c.b1),
                &values(c.w2),
                &values(c.b2),
                &values(c.w3),
                &values(c.b3),
            ]),
            config,
            columns,
        }
    }

    /// Signed distance, feature and normal of `points: [n, 3]`.
    #[must_use]
    pub fn geometry(&self, points: &[f32]) -> Geometry {
        Geometry {
            values: sdf_field::evaluate(points, &self.table, self.sdf.clone(), &self.config),
            columns: self.columns,
        }
    }

    /// Colours `[n, C]` of points with the geometry that [`FrozenSurface::geometry`] returned.
    ///
    /// `directions: [n, 3]` are unit; `extra` is `[n, E]`.
    #[must_use]
    pub fn colour(
        &self,
        geometry: &Geometry,
        points: &[f32],
        directions: &[f32],
        extra: &[f32],
    ) -> Vec<f32> {
        colour_field::evaluate(
            colour_field::Inputs {
                geometry: &geometry.values,
                points,
                directions,
                extra,
            },
            self.colour.clone(),
        )
    }
}

fn values<const D: usize>(tensor: burn::Tensor<D>) -> Vec<f32> {
    match tensor.into_data().try_to_vec::<f32>() {
        Ok(values) => values,
        Err(error) => panic!("FrozenSurface: weights are not f32: {error:?}"),
    }
}
