//! What is timed on a device: the ops with inputs as large as a step's at the paper's sizes.

use std::sync::Arc;

use burn::backend::DispatchTensorKind;
use burn::tensor::{Device, Tensor, TensorData};
use gpu_tensors::{CubeTensor, Packed, PointMatrix, WeightReads, from_slice, padded};
use hashgrid::{GridLayout, SparseGrad};
use neus_render::composite::{self, CompositeConfig, Packing};
use neus_render::march::{DeviceGrids, MarchConfig, march_on_device, rays_on};
use neus_render::occupancy::{DeviceBits, OccupancyGrid};
use neus_render::rays::Ray;
use scene_decomp::Surface;
use scene_decomp::colour_field::{ColourFieldInputs, colour_field};

use crate::equal::Sizes;
use crate::fields::{Cost, VALUE, ray_points, surface_config};

/// FoCoR at the paper's sizes, and points to ask it about.
pub(super) struct Case {
    pub(super) surface: Surface,
    layout: Arc<GridLayout>,
    pub(super) gradient: SparseGrad,
    points: Tensor<2>,
    directions: Tensor<2>,
}

impl Case {
    pub(super) fn new(count: usize, layout: &Arc<GridLayout>, device: &Device) -> Self {
        let mut surface = Surface::new(&surface_config(), 1, device);
        surface.grid.table = surface.grid.table.set_require_grad(false);
        let (points, directions) = ray_points(count);
        let rows =
            |values: Vec<f32>| Tensor::from_data(TensorData::new(values, [count, 3]), device);
        Self {
            gradient: SparseGrad::new(layout),
            layout: layout.clone(),
            points: rows(points),
            directions: rows(directions),
            surface,
        }
    }

    pub(super) fn geometry(&self) -> Tensor<2> {
        let levels = self.layout.levels.len();
        let config = self
            .surface
            .sdf_config(&self.layout, levels, Some(self.gradient.clone()));
        self.surface.geometry(self.points.clone(), config)
    }

    pub(super) fn colour(&self, geometry: Tensor<2>) -> Tensor<2> {
        let [n, _] = geometry.dims();
        let inputs = ColourFieldInputs {
            extra: Tensor::zeros([n, 0], &geometry.device()),
            geometry,
            points: self.points.clone(),
            directions: self.directions.clone(),
        };
        colour_field(inputs, self.surface.colour_weights())
    }
}

/// Samples of both fields on rays, for compositing.
pub(super) struct Rays {
    object: Tensor<2>,
    background: Tensor<2>,
    sharpness: Tensor<1>,
    packing: Arc<Packing>,
}

impl Rays {
    pub(super) fn new(sizes: Sizes, device: &Device) -> Self {
        let n = sizes.rays * sizes.samples;
        let rows = |columns: usize| {
            let values = (0..n * columns).map(|i| (i % 7) as f32 * 0.1 - 0.2);
            let values: Vec<f32> = values.collect();
            Tensor::from_data(TensorData::new(values, [n, columns]), device)
        };
        let ends = (0..=sizes.rays).map(|ray| (ray * sizes.samples) as u32);
        let all: Vec<u32> = (0..n as u32).collect();
        let step = 2.0 / sizes.samples as f32;
        let t = (0..n).map(|i| (i % sizes.samples) as f32 * step).collect();
        Self {
            object: rows(composite::object_column::COUNT),
            background: rows(composite::background_column::COUNT),
            sharpness: Tensor::from_floats([20.0, 20.0], device),
            packing: Arc::new(Packing::new(
                ends.collect(),
                t,
                vec![step; n],
                all.clone(),
                all,
            )),
        }
    }

    /// With gradients of all samples' rows.
    pub(super) fn learnt(self) -> Self {
        Self {
            object: self.object.require_grad(),
            background: self.background.require_grad(),
            ..self
        }
    }

    /// Of a sample of both fields, whose rows pass through memory so often.
    pub(super) fn cost(passes: f64) -> Cost {
        let columns = composite::object_column::COUNT + composite::background_column::COUNT;
        Cost {
            flops: 0.0,
            bytes: passes * VALUE * columns as f64,
            scattered: 0.0,
            added: 0.0,
        }
    }

    pub(super) fn pixels(&self) -> Tensor<2> {
        composite::composite(
            self.object.clone(),
            self.background.clone(),
            self.sharpness.clone(),
            self.packing.clone(),
            CompositeConfig::default(),
        )
    }
}

/// Rays through a grid in which everything is occupied, for marching.
pub(super) struct Marching {
    rays: Tensor<2>,
    bits: DeviceBits,
    config: MarchConfig,
    capacity: usize,
}

impl Marching {
    /// Of an interval: midpoint, length and flags are written. The grid's bits are in the cache.
    pub(super) const COST: Cost = Cost {
        flops: 0.0,
        bytes: 3.0 * VALUE,
        scattered: 0.0,
        added: 0.0,
    };

    /// Rays side by side, with as many steps across the box as there are samples.
    pub(super) fn new(sizes: Sizes, device: &Device) -> Self {
        let rays: Vec<Ray> = (0..sizes.rays)
            .map(|i| {
                let x = 1.8 * (i as f32 + 0.5) / sizes.rays as f32 - 0.9;
                Ray {
                    origin: glam::Vec3::new(x, -x, -3.0),
                    direction: glam::Vec3::Z,
                }
            })
            .collect();
        let mut grid = OccupancyGrid::new(128, 1.0);
        grid.set_all(1.0);
        Self {
            rays: rays_on(device, &rays),
            bits: DeviceBits::upload(&grid, device),
            config: MarchConfig {
                step_object: 2.0 / sizes.samples as f32,
                ..MarchConfig::default()
            },
            capacity: sizes.rays * sizes.samples,
        }
    }

    pub(super) fn march(&self) {
        let grids = DeviceGrids {
            object: Some(&self.bits),
            background: None,
        };
        drop(march_on_device(
            self.rays.clone(),
            grids,
            &self.config,
            self.capacity,
        ));
    }
}

/// A hidden layer of the paper's networks, by itself.
pub(super) struct Layer {
    weight: CubeTensor,
    bias: CubeTensor,
    reads: WeightReads,
    x: PointMatrix,
}

impl Layer {
    const WIDTH: usize = 64;

    /// Of a point: its inputs and its outputs pass through memory.
    pub(super) const COST: Cost = Cost {
        flops: (2 * Self::WIDTH * (Self::WIDTH + 1)) as f64,
        bytes: (2 * Self::WIDTH) as f64 * VALUE,
        scattered: 0.0,
        added: 0.0,
    };

    /// `None` where CubeCL does not run the device.
    pub(super) fn new(points: usize, reads: WeightReads, device: &Device) -> Option<Self> {
        let like = Tensor::<1>::zeros([1], device).into_dispatch();
        let DispatchTensorKind::Cube(like) = like.kind else {
            return None;
        };
        let like = like.float();
        let value = |i: usize| (i % 11) as f32 * 0.01 - 0.05;
        let values = |count: usize| -> Vec<f32> { (0..count).map(value).collect() };
        let width = Self::WIDTH;
        let weight = from_slice(&like, &values(width * width), [width, width]);
        let bias = from_slice(&like, &values(width), [width]);
        let (rows, points) = (width + 1, padded(points));
        let shape = [padded(rows), points];
        let data = from_slice(&like, &values(shape[0] * points), shape);
        Some(Self {
            weight,
            bias,
            reads,
            x: PointMatrix { data, rows, points },
        })
    }

    /// What is made of the weights beforehand counts: they are others in each step.
    pub(super) fn apply(&self) {
        let layer = Packed::forward(&self.weight, &self.bias).reading(self.reads);
        drop(layer.apply(&self.x));
    }
}
