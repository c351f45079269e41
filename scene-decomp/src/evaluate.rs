//! A trained surface without gradients, for occupancy, renders and meshes.

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::Device;
use hashgrid::GridLayout;
use tensor_slices::matrix;

use crate::colour_field::{ColourFieldInputs, ColourFieldWeights, colour_field};
use crate::directions::colour_extra;
use crate::sdf_field::{Forward, Normal, SdfFieldConfig, SdfFieldWeights, Tape, sdf_field};
use crate::surface::Surface;

/// Points that are asked about at once: the rows of all pixels of a photo are more than some devices bind.
const AT_ONCE: usize = 1 << 16;

/// A surface that answers for plain lists of points, without autodiff.
///
/// It shares the tensors' memory: nothing is copied, and later training does not change it.
#[derive(Clone, Debug)]
pub struct FrozenSurface {
    sdf: SdfFieldWeights,
    colour: ColourFieldWeights,
    config: SdfFieldConfig,
    direction_degree: u32,
    device: Device,
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

    /// Feature `k` of point `i`.
    ///
    /// # Panics
    /// When the field was asked without its features.
    #[must_use]
    pub fn feature(&self, i: usize, k: usize) -> f32 {
        assert!(k + 4 < self.columns, "Geometry::feature: no feature {k}");
        self.values[i * self.columns + 1 + k]
    }

    /// Normal of point `i`: the sdf's gradient, not normalised.
    #[must_use]
    pub fn normal(&self, i: usize) -> glam::Vec3 {
        let end = (i + 1) * self.columns;
        glam::Vec3::from_slice(&self.values[end - 3..end])
    }

    /// The rows of `chosen` points.
    #[must_use]
    pub fn select(&self, chosen: &[u32]) -> Self {
        let mut values = Vec::with_capacity(chosen.len() * self.columns);
        for &i in chosen {
            let start = i as usize * self.columns;
            values.extend_from_slice(&self.values[start..start + self.columns]);
        }
        Self {
            values,
            columns: self.columns,
        }
    }
}

impl FrozenSurface {
    /// `surface`, of which `active_levels` are in use.
    #[must_use]
    pub fn new(surface: &Surface, layout: &Arc<GridLayout>, active_levels: usize) -> Self {
        let s = surface.sdf_weights();
        let c = surface.colour_weights();
        let sdf = SdfFieldWeights {
            table: constant(s.table),
            w1: constant(s.w1),
            b1: constant(s.b1),
            w2: constant(s.w2),
            b2: constant(s.b2),
        };
        Self {
            device: sdf.table.device(),
            sdf,
            colour: ColourFieldWeights {
                w1: constant(c.w1),
                b1: constant(c.b1),
                w2: constant(c.w2),
                b2: constant(c.b2),
                w3: constant(c.w3),
                b3: constant(c.b3),
            },
            config: surface.sdf_config(layout, active_levels, None),
            direction_degree: surface.direction_degree(),
        }
    }

    /// The same field without its features: rows of [`FrozenSurface::geometry`] are `(sdf, normal)`.
    ///
    /// Whoever asks for no colours saves most of the output layer, and the memory of its values.
    #[must_use]
    pub fn without_features(mut self) -> Self {
        self.sdf.w2 = self.sdf.w2.narrow(0, 0, 1);
        self.sdf.b2 = self.sdf.b2.narrow(0, 0, 1);
        self
    }

    /// A copy on another device, which later training does not reach either. Waits for the device that it is on.
    ///
    /// # Panics
    /// When that device is lost.
    #[must_use]
    pub fn to_device(self, device: &Device) -> Self {
        let (sdf, colour) = (self.sdf, self.colour);
        Self {
            sdf: SdfFieldWeights {
                table: moved(sdf.table, device),
                w1: moved(sdf.w1, device),
                b1: moved(sdf.b1, device),
                w2: moved(sdf.w2, device),
                b2: moved(sdf.b2, device),
            },
            colour: ColourFieldWeights {
                w1: moved(colour.w1, device),
                b1: moved(colour.b1, device),
                w2: moved(colour.w2, device),
                b2: moved(colour.b2, device),
                w3: moved(colour.w3, device),
                b3: moved(colour.b3, device),
            },
            device: device.clone(),
            ..self
        }
    }

    /// Signed distance, feature and normal of `points: [n, 3]`.
    #[must_use]
    pub fn geometry(&self, points: &[f32]) -> Geometry {
        self.geometry_of(points.to_vec())
    }

    /// Columns of [`FrozenSurface::geometry`]'s answers.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.sdf.b2.dims()[0] + 3
    }

    /// [`FrozenSurface::geometry`] of points that are handed over.
    #[must_use]
    pub fn geometry_of(&self, points: Vec<f32>) -> Geometry {
        self.geometry_with(points, self.config.clone())
    }

    /// The same, with what a backward pass needs written down on `tape`, by one thread. The tape stays empty
    /// where a GPU computes.
    #[must_use]
    pub fn geometry_taped(&self, points: Vec<f32>, tape: &Tape) -> Geometry {
        let config = SdfFieldConfig {
            forward: Forward::Taped(tape.clone()),
            ..self.config.clone()
        };
        self.geometry_with(points, config)
    }

    fn geometry_with(&self, points: Vec<f32>, config: SdfFieldConfig) -> Geometry {
        let columns = self.columns();
        if points.is_empty() {
            return Geometry {
                values: Vec::new(),
                columns,
            };
        }
        // One tape is of one call.
        if let Forward::Taped(_) = config.forward {
            let values = self.outputs(points, config);
            return Geometry { values, columns };
        }
        let mut values = Vec::new();
        self.in_parts(points, &config, |rows| match values.is_empty() {
            // Nearly always all of them: not copied.
            true => values = rows,
            false => values.extend_from_slice(&rows),
        });
        Geometry { values, columns }
    }

    /// The op's rows for `points: [n, 3]`.
    fn outputs(&self, points: Vec<f32>, config: SdfFieldConfig) -> Vec<f32> {
        values(sdf_field(self.rows(points, 3), self.sdf.clone(), config))
    }

    /// The same, so many at once that a device can bind them.
    fn in_parts(&self, points: Vec<f32>, config: &SdfFieldConfig, mut take: impl FnMut(Vec<f32>)) {
        if points.len() <= 3 * AT_ONCE {
            return take(self.outputs(points, config.clone()));
        }
        for part in points.chunks(3 * AT_ONCE) {
            take(self.outputs(part.to_vec(), config.clone()));
        }
    }

    /// Signed distances `[n]` alone of `points: [n, 3]`: no normals are computed.
    #[must_use]
    pub fn distances_of(&self, points: Vec<f32>) -> Vec<f32> {
        if points.is_empty() {
            return Vec::new();
        }
        let config = SdfFieldConfig {
            normal: Normal::Zero,
            ..self.config.clone()
        };
        let mut distances = Vec::with_capacity(points.len() / 3);
        self.in_parts(points, &config, |out| {
            distances.extend(out.chunks_exact(self.columns()).map(|row| row[0]));
        });
        distances
    }

    /// Gradients of the first output at `points: [n, 3]`, not normalised, also of a field that is read
    /// as a density. They point to where there is less of it.
    #[must_use]
    pub fn gradients_of(&self, points: Vec<f32>) -> Vec<glam::Vec3> {
        if points.is_empty() {
            return Vec::new();
        }
        let config = SdfFieldConfig {
            normal: Normal::Computed,
            ..self.config.clone()
        };
        let mut gradients = Vec::with_capacity(points.len() / 3);
        self.in_parts(points, &config, |out| {
            let rows = out.chunks_exact(self.columns());
            gradients.extend(rows.map(|row| glam::Vec3::from_slice(&row[row.len() - 3..])));
        });
        gradients
    }

    /// Colours `[n, C]` of points with the geometry that [`FrozenSurface::geometry`] returned.
    ///
    /// `directions` is `[n, 3]`, `extra` `[n, E]`.
    ///
    /// # Panics
    /// When the surface is one [`without_features`](FrozenSurface::without_features).
    #[must_use]
    pub fn colour(
        &self,
        geometry: &Geometry,
        points: &[f32],
        directions: &[f32],
        extra: &[f32],
    ) -> Vec<f32> {
        let n = points.len() / 3;
        if n == 0 {
            return Vec::new();
        }
        let columns = extra.len() / n;
        let mut colours = Vec::new();
        for start in (0..n).step_by(AT_ONCE) {
            let part = start..(start + AT_ONCE).min(n);
            let within = |columns: usize| columns * part.start..columns * part.end;
            let directions = &directions[within(3)];
            let extra = colour_extra(directions, &extra[within(columns)], self.direction_degree);
            let geometry_rows = geometry.values[within(geometry.columns)].to_vec();
            let width = extra.len() / part.len();
            colours.extend(values(colour_field(
                ColourFieldInputs {
                    geometry: self.rows(geometry_rows, geometry.columns),
                    points: self.rows(points[within(3)].to_vec(), 3),
                    directions: self.rows(directions.to_vec(), 3),
                    extra: matrix(extra, [part.len(), width], &self.device),
                },
                self.colour.clone(),
            )));
        }
        colours
    }

    fn rows(&self, values: Vec<f32>, columns: usize) -> Tensor<2> {
        let n = values.len() / columns;
        matrix(values, [n, columns], &self.device)
    }
}

/// The same tensor outside autodiff.
fn constant<const D: usize>(tensor: Tensor<D>) -> Tensor<D> {
    if tensor.is_autodiff() {
        tensor.inner()
    } else {
        tensor
    }
}

/// The same values on another device.
fn moved<const D: usize>(tensor: Tensor<D>, device: &Device) -> Tensor<D> {
    let data = tensor.to_data();
    // A GPU's memory is copied when somebody first looks, and may be written to as soon as `tensor` is gone.
    let _ = data.as_bytes().first();
    Tensor::from_data(data, device)
}

fn values(tensor: Tensor<2>) -> Vec<f32> {
    match tensor.into_data().try_into_vec::<f32>() {
        Ok(values) => values,
        Err(error) => panic!("FrozenSurface: weights are not f32: {error:?}"),
    }
}
