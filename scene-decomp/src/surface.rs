//! One neural surface: hash grid, SDF network and colour network (method: M_S and M_C).

use std::sync::Arc;

use burn::Tensor;
use burn::module::Module;
use burn::tensor::Device;
use hashgrid::{GridConfig, GridConfigError, GridLayout, HashGrid, SparseGrad};
use serde::{Deserialize, Serialize};
use tensor_slices::matrix;

use crate::colour_field::{
    ColourFieldInputs, ColourFieldWeights, RowConfig, colour_field, sample_rows,
};
use crate::dense::{Dense, Random};
use crate::directions::{MOST_DEGREE, colour_extra, harmonics};
use crate::sdf_field::{Forward, Normal, SdfFieldConfig, SdfFieldWeights, sdf_field};

/// The sign of the sphere that a field starts from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum InitialShape {
    /// A ball of this radius: positive outside.
    Ball(f32),
    /// A hollow of this radius: positive inside, as a room is.
    Hollow(f32),
    /// The same value everywhere: for a field that is read as a density, so that it begins without fog before some of the
    /// cameras, which their photos would be painted on.
    Flat(f32),
    /// Values around this one, by a network of random weights: for densities that begin beside another, which nothing would
    /// tell apart otherwise.
    Uneven(f32),
}

/// The sizes of a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceConfig {
    /// The hash grid.
    pub grid: GridConfig,
    /// Width of hidden layers.
    pub hidden: usize,
    /// Width G of the geometry feature.
    pub features: usize,
    /// Further inputs of the colour network.
    pub extra: usize,
    /// Degree of the [`spherical_harmonics`](crate::directions::spherical_harmonics) that the colour network sees beside the direction,
    /// 0 to 4.
    pub direction_degree: u32,
    /// Outputs of the colour network: 3, or 4 with an alpha head.
    pub outputs: usize,
    /// The field covers `[-half_side, half_side]^3`; positive.
    pub half_side: f32,
    /// The softplus' sharpness; positive.
    pub beta: f32,
    /// What the field is before training.
    pub initial: InitialShape,
}

/// Why a [`SurfaceConfig`] can't be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SurfaceConfigError {
    /// There is no such hash grid.
    #[error(transparent)]
    Grid(#[from] GridConfigError),
    /// Networks need a hidden layer.
    #[error("a surface's hidden layers need a width of at least 1")]
    NoHidden,
    /// Harmonics are written out up to degree 4.
    #[error("the degree of a surface's view directions must be within 0..=4, not {0}")]
    DirectionDegree(u32),
    /// A colour, with or without an alpha head.
    #[error("a surface's colour network has 3 outputs, or 4 with an alpha head, not {0}")]
    Outputs(usize),
    /// The field must cover something.
    #[error("half the side of a surface's cube must be a positive number, not {0}")]
    HalfSide(f32),
    /// A softplus of no sharpness is infinite.
    #[error("the sharpness of a surface's softplus must be a positive number, not {0}")]
    Beta(f32),
    /// Networks are initialised to numbers.
    #[error("a surface cannot begin as {0:?}, which is no number")]
    Initial(InitialShape),
}

impl SurfaceConfig {
    /// Checks that the numbers describe a surface that the kernels can handle.
    ///
    /// # Errors
    /// The first rule that is broken.
    pub fn validate(&self) -> Result<(), SurfaceConfigError> {
        self.grid.validate()?;
        if self.hidden == 0 {
            return Err(SurfaceConfigError::NoHidden);
        }
        if self.direction_degree > MOST_DEGREE {
            return Err(SurfaceConfigError::DirectionDegree(self.direction_degree));
        }
        if !(3..=4).contains(&self.outputs) {
            return Err(SurfaceConfigError::Outputs(self.outputs));
        }
        let is_positive = |value: f32| value > 0.0 && value.is_finite();
        if !is_positive(self.half_side) {
            return Err(SurfaceConfigError::HalfSide(self.half_side));
        }
        if !is_positive(self.beta) {
            return Err(SurfaceConfigError::Beta(self.beta));
        }
        let (InitialShape::Ball(value)
        | InitialShape::Hollow(value)
        | InitialShape::Flat(value)
        | InitialShape::Uneven(value)) = self.initial;
        if !value.is_finite() {
            return Err(SurfaceConfigError::Initial(self.initial));
        }
        Ok(())
    }
}

/// Networks and grid of one field.
#[derive(Module, Debug)]
pub struct Surface {
    /// The hash grid.
    pub grid: HashGrid,
    /// M_S: hidden and output layer.
    pub sdf: [Dense; 2],
    /// M_C: two hidden layers and the output layer.
    pub colour: [Dense; 3],
    half_side: f32,
    beta: f32,
    flat: bool,
    direction_degree: u32,
}

/// What a surface says about points.
#[derive(Clone, Debug)]
pub struct SurfaceSamples {
    /// `[n, 1 + G + 3]`: sdf, feature, normal.
    pub geometry: Tensor<2>,
    /// `[n, C]`: colour, and alpha where there is a head for it; in `[0, 1]`.
    pub colour: Tensor<2>,
}

impl SurfaceSamples {
    /// Signed distances, `[n, 1]`.
    #[must_use]
    pub fn sdf(&self) -> Tensor<2> {
        let [n, _] = self.geometry.dims();
        self.geometry.clone().slice([0..n, 0..1])
    }

    /// Normals, `[n, 3]`, not normalised.
    #[must_use]
    pub fn normal(&self) -> Tensor<2> {
        let [n, columns] = self.geometry.dims();
        self.geometry.clone().slice([0..n, columns - 3..columns])
    }
}

impl Surface {
    /// Seeded, geometrically initialised: the sdf starts as that of `config.initial`.
    ///
    /// SAL's initialisation (Atzmon and Lipman 2020) for one hidden layer of width `m`: columns of
    /// the position `N(0, 2 / m)`, columns of the encoding 0, output weights with mean
    /// `sqrt(pi / m)`, so that the sum over the hidden layer is about `|p|`; bias `-r`.
    ///
    /// # Panics
    /// When the configuration is not valid: see [`SurfaceConfig::validate`].
    #[must_use]
    pub fn new(config: &SurfaceConfig, seed: u64, device: &Device) -> Self {
        if let Err(error) = config.validate() {
            panic!("Surface::new: {error}");
        }
        let mut random = Random::new(seed);
        let layout = GridLayout::new(&config.grid);
        let hidden = config.hidden;
        let inputs = 3 + layout.features();
        let position = random.normals(3 * hidden, 0.0, (2.0 / hidden as f32).sqrt());
        let mut w1 = vec![0.0; hidden * inputs];
        for (row, position) in w1.chunks_exact_mut(inputs).zip(position.chunks_exact(3)) {
            row[..3].copy_from_slice(position);
        }
        let (sign, radius) = match config.initial {
            InitialShape::Ball(radius) => (1.0, radius),
            InitialShape::Hollow(radius) => (-1.0, radius),
            InitialShape::Flat(value) | InitialShape::Uneven(value) => (0.0, value),
        };
        let he = (2.0 / hidden as f32).sqrt();
        if sign == 0.0 {
            w1 = random.normals(hidden * inputs, 0.0, (2.0 / inputs as f32).sqrt());
        }
        let mean = sign * (std::f32::consts::PI / hidden as f32).sqrt();
        let deviation = match config.initial {
            InitialShape::Uneven(_) => he,
            _ => 1e-4,
        };
        let mut w2 = random.normals(hidden, mean, deviation);
        w2.extend(random.normals(hidden * config.features, 0.0, he));
        let mut b2 = vec![0.0; 1 + config.features];
        b2[0] = if sign == 0.0 { radius } else { -sign * radius };
        let colour_inputs =
            9 + 1 + config.features + config.extra + harmonics(config.direction_degree);
        Self {
            grid: HashGrid::new(&config.grid, seed, device),
            sdf: [
                Dense::from_values(w1, vec![0.0; hidden], device),
                Dense::from_values(w2, b2, device),
            ],
            colour: [
                Dense::he(colour_inputs, hidden, &mut random, device),
                Dense::he(hidden, hidden, &mut random, device),
                Dense::he(hidden, config.outputs, &mut random, device),
            ],
            half_side: config.half_side,
            beta: config.beta,
            flat: sign == 0.0,
            direction_degree: config.direction_degree,
        }
    }

    /// A field that is read as a density has no use for a normal.
    fn normal(&self) -> Normal {
        if self.flat {
            Normal::Zero
        } else {
            Normal::Computed
        }
    }

    /// The op's settings for this surface.
    #[must_use]
    pub fn sdf_config(
        &self,
        layout: &Arc<GridLayout>,
        active_levels: usize,
        sparse: Option<SparseGrad>,
    ) -> SdfFieldConfig {
        SdfFieldConfig {
            layout: layout.clone(),
            active_levels,
            half_side: self.half_side,
            beta: self.beta,
            normal: self.normal(),
            sparse,
            forward: Forward::Alone,
        }
    }

    /// The SDF network's tensors.
    #[must_use]
    pub fn sdf_weights(&self) -> SdfFieldWeights {
        let [first, second] = &self.sdf;
        SdfFieldWeights {
            table: self.grid.table.val(),
            w1: first.weight.val(),
            b1: first.bias.val(),
            w2: second.weight.val(),
            b2: second.bias.val(),
        }
    }

    /// The colour network's tensors.
    #[must_use]
    pub fn colour_weights(&self) -> ColourFieldWeights {
        let [first, second, third] = &self.colour;
        ColourFieldWeights {
            w1: first.weight.val(),
            b1: first.bias.val(),
            w2: second.weight.val(),
            b2: second.bias.val(),
            w3: third.weight.val(),
            b3: third.bias.val(),
        }
    }

    /// Geometry `[n, 1 + G + 3]` of `points: [n, 3]`.
    #[must_use]
    pub fn geometry(&self, points: Tensor<2>, config: SdfFieldConfig) -> Tensor<2> {
        sdf_field(points, self.sdf_weights(), config)
    }

    /// Degree of the harmonics that the colour network sees beside the direction.
    #[must_use]
    pub fn direction_degree(&self) -> u32 {
        self.direction_degree
    }

    /// Geometry and colour of `points: [n, 3]` seen along `directions: [n, 3]`.
    ///
    /// `extra` is `[n, E]`; `E` is zero for FoCoR and one, m^P, for BaCo.
    #[must_use]
    pub fn sample(
        &self,
        points: &[f32],
        directions: &[f32],
        extra: &[f32],
        config: SdfFieldConfig,
    ) -> SurfaceSamples {
        let inputs = self.inputs(points, directions, extra, 1.0, config);
        SurfaceSamples {
            geometry: inputs.geometry.clone(),
            colour: colour_field(inputs, self.colour_weights()),
        }
    }

    /// Rows for compositing, `[n, 3 + C]`, of `points: [n, 3]` seen along unit `directions: [n, 3]`:
    /// see [`row_column`](crate::colour_field::row_column).
    ///
    /// `extra` is as for [`Surface::sample`]; `stretch` `[n]` multiplies densities, and is empty where
    /// nothing is to be multiplied.
    #[must_use]
    pub fn sample_rows(
        &self,
        points: &[f32],
        directions: &[f32],
        [extra, stretch]: [&[f32]; 2],
        config: SdfFieldConfig,
        rows: RowConfig,
    ) -> Tensor<2> {
        let inputs = [points, directions, extra, stretch];
        self.rows_and_geometry(inputs, config, rows).0
    }

    /// [`Surface::sample_rows`] with the geometry below it, `[n, 1 + G + 3]`, for whoever reads more of
    /// it than compositing does.
    ///
    /// The lists are `points`, `directions`, `extra` and `stretch`, as there.
    #[must_use]
    pub fn rows_and_geometry(
        &self,
        [points, directions, extra, stretch]: [&[f32]; 4],
        config: SdfFieldConfig,
        rows: RowConfig,
    ) -> (Tensor<2>, Tensor<2>) {
        let n = points.len() / 3;
        let inputs = self.inputs(points, directions, extra, rows.view_share, config);
        let geometry = inputs.geometry.clone();
        let columns = stretch.len().checked_div(n).unwrap_or(0);
        let stretch = matrix(stretch.to_vec(), [n, columns], &inputs.points.device());
        let rows = sample_rows(inputs, stretch, self.colour_weights(), rows);
        (rows, geometry)
    }

    /// The harmonics are of `view_share` of the directions, as the op's own are.
    fn inputs(
        &self,
        points: &[f32],
        directions: &[f32],
        extra: &[f32],
        view_share: f32,
        config: SdfFieldConfig,
    ) -> ColourFieldInputs {
        let n = points.len() / 3;
        let device = self.grid.table.val().device();
        let rows = |values: Vec<f32>, columns: usize| matrix(values, [n, columns], &device);
        let points = rows(points.to_vec(), 3);
        let extra = if harmonics(self.direction_degree) == 0 {
            extra.to_vec()
        } else {
            let views: Vec<f32> = directions.iter().map(|v| view_share * v).collect();
            colour_extra(&views, extra, self.direction_degree)
        };
        let geometry = self.geometry(points.clone(), config);
        // What the network has inputs for: without points the values do not tell.
        let inputs = self.colour[0].weight.dims()[1];
        let columns = inputs - 6 - geometry.dims()[1];
        ColourFieldInputs {
            geometry,
            points,
            directions: rows(directions.to_vec(), 3),
            extra: rows(extra, columns),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn config() -> SurfaceConfig {
        SurfaceConfig {
            grid: GridConfig {
                levels: 2,
                ..GridConfig::default()
            },
            hidden: 8,
            features: 0,
            extra: 0,
            direction_degree: 4,
            outputs: 3,
            half_side: 1.0,
            beta: 100.0,
            initial: InitialShape::Ball(0.5),
        }
    }

    #[test]
    fn bad_configurations_are_named() {
        assert_eq!(config().validate(), Ok(()));
        let bad = |change: fn(&mut SurfaceConfig)| {
            let mut config = config();
            change(&mut config);
            config.validate().unwrap_err()
        };
        assert_eq!(
            bad(|c| c.grid.levels = 0),
            SurfaceConfigError::Grid(GridConfigError::NoLevels)
        );
        assert_eq!(bad(|c| c.hidden = 0), SurfaceConfigError::NoHidden);
        assert_eq!(
            bad(|c| c.direction_degree = 7),
            SurfaceConfigError::DirectionDegree(7)
        );
        for (outputs, error) in [(2, bad(|c| c.outputs = 2)), (5, bad(|c| c.outputs = 5))] {
            assert_eq!(error, SurfaceConfigError::Outputs(outputs));
        }
        assert_eq!(
            bad(|c| c.half_side = 0.0),
            SurfaceConfigError::HalfSide(0.0)
        );
        assert!(matches!(
            bad(|c| c.half_side = f32::NAN),
            SurfaceConfigError::HalfSide(_)
        ));
        assert_eq!(bad(|c| c.beta = 0.0), SurfaceConfigError::Beta(0.0));
        assert_eq!(bad(|c| c.beta = -1.0), SurfaceConfigError::Beta(-1.0));
        assert_eq!(
            bad(|c| c.initial = InitialShape::Flat(f32::INFINITY)),
            SurfaceConfigError::Initial(InitialShape::Flat(f32::INFINITY))
        );
    }

    #[test]
    #[should_panic(expected = "Surface::new: a surface's colour network has 3 outputs")]
    fn a_bad_configuration_makes_no_surface() {
        let config = SurfaceConfig {
            outputs: 5,
            ..config()
        };
        let _ = Surface::new(&config, 1, &Device::flex());
    }
}
