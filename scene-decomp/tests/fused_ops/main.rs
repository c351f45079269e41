//! The fused ops against their references: values, gradients, and derivatives by differences.
#![allow(clippy::unwrap_used)]
// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

mod derivatives;
mod odd_batches;
mod surfaces;

use std::sync::Arc;

use burn::Tensor;
use burn::tensor::{Device, Gradients, TensorData};
use hashgrid::{GridConfig, GridLayout, Hash, Interpolation, SparseGrad};
use scene_decomp::colour_field::{self, ColourFieldInputs, Reading, RowConfig};
use scene_decomp::sdf_field::{self, Forward, SdfFieldConfig, SdfFieldWeights, Tape, TapedRows};
use scene_decomp::{InitialShape, Surface, SurfaceConfig};

/// Sums of up to 64 products in another order, in single precision, through two layers.
const VALUE_TOLERANCE: f32 = 2e-5;
/// Gradients sum over all points as well; relative to the largest entry.
const GRADIENT_TOLERANCE: f32 = 2e-4;

fn numbers(count: usize, seed: u32) -> Vec<f32> {
    let mut state = seed;
    (0..count)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        })
        .collect()
}

fn config() -> SurfaceConfig {
    SurfaceConfig {
        grid: GridConfig {
            levels: 5,
            base_resolution: 4,
            finest_resolution: 40,
            log2_table_size: 10,
            ..GridConfig::default()
        },
        hidden: 64,
        features: 7,
        extra: 1,
        direction_degree: 1,
        outputs: 4,
        half_side: 2.0,
        // Softer than the default: the references differ by rounding times the sharpness.
        beta: 20.0,
        initial: InitialShape::Ball(0.5),
    }
}

/// A surface whose table and encoding weights are not the zeros of the initialisation.
fn surface(device: &Device) -> Surface {
    surface_of(&config(), device)
}

/// [`surface`] of other sizes.
fn surface_of(config: &SurfaceConfig, device: &Device) -> Surface {
    let mut surface = Surface::new(config, 3, device);
    let entries = GridLayout::new(&config.grid).entries();
    let table = numbers(entries * 2, 5)
        .iter()
        .map(|v| 0.3 * v)
        .collect::<Vec<_>>();
    surface.grid.table = surface.grid.table.map(|_| {
        Tensor::<2>::from_data(TensorData::new(table, [entries, 2]), device).require_grad()
    });
    let shape = surface.sdf[0].weight.dims();
    let weight = numbers(shape[0] * shape[1], 6)
        .iter()
        .map(|v| 0.4 * v)
        .collect::<Vec<_>>();
    surface.sdf[0].weight = surface.sdf[0]
        .weight
        .clone()
        .map(|_| Tensor::<2>::from_data(TensorData::new(weight, shape), device).require_grad());
    surface
}

fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values, shape), device)
}

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_to_vec::<f32>().unwrap()
}

fn assert_close(name: &str, a: &[f32], b: &[f32], tolerance: f32) {
    assert_eq!(a.len(), b.len(), "{name}: lengths");
    let scale = b.iter().fold(1e-3f32, |m, v| m.max(v.abs()));
    for (i, (a, b)) in a.iter().zip(b).enumerate() {
        assert!(
            (a - b).abs() <= tolerance * scale,
            "{name}[{i}]: {a} and {b}, scale {scale}"
        );
    }
}

/// Gradients of the five weights, in their order.
fn of_weights(weights: &SdfFieldWeights, grads: &Gradients) -> Vec<Vec<f32>> {
    vec![
        values(weights.table.grad(grads).unwrap()),
        values(weights.w1.grad(grads).unwrap()),
        values(weights.b1.grad(grads).unwrap()),
        values(weights.w2.grad(grads).unwrap()),
        values(weights.b2.grad(grads).unwrap()),
    ]
}

/// Value of the op, its reference, and all gradients of a weighted sum of the outputs.
fn both_sdf(
    device: &Device,
    grid: &GridConfig,
    n: usize,
    active: usize,
    normal: sdf_field::Normal,
) -> [(Vec<f32>, Vec<Vec<f32>>); 2] {
    let device = &device.clone().autodiff();
    let config = SurfaceConfig {
        grid: grid.clone(),
        ..config()
    };
    let layout = Arc::new(GridLayout::new(grid));
    let points = numbers(3 * n, 11)
        .iter()
        .map(|v| 1.9 * v)
        .collect::<Vec<_>>();
    let upstream = numbers(n * 11, 12);
    [false, true].map(|reference| {
        let surface = surface_of(&config, device);
        let mut settings = surface.sdf_config(&layout, active, None);
        settings.normal = normal;
        let points = tensor(points.clone(), [n, 3], device);
        let weights = surface.sdf_weights();
        let out = if reference {
            sdf_field::reference::sdf_field(points, weights.clone(), settings)
        } else {
            sdf_field::sdf_field(points, weights.clone(), settings)
        };
        let loss = out
            .clone()
            .mul(tensor(upstream.clone(), [n, 11], device))
            .sum();
        let grads = loss.backward();
        (values(out), of_weights(&weights, &grads))
    })
}

#[test]
fn sdf_field_equals_its_reference() {
    let linear = config().grid;
    let grids = [
        (Interpolation::Linear, Hash::Blocks),
        (Interpolation::Smoothstep, Hash::Nodes),
        (Interpolation::Smoothstep, Hash::Blocks),
    ];
    let [blocks, smooth, both] = grids.map(|(interpolation, hash)| GridConfig {
        interpolation,
        hash,
        ..linear.clone()
    });
    for device in [Device::flex(), Device::ndarray()] {
        // One point, a part of a tile, several tiles and a rest; all levels, and some.
        for (n, active, grid) in [
            (1, 5, &linear),
            (17, 2, &linear),
            (129, 3, &linear),
            (300, 5, &linear),
            (2100, 3, &linear),
            (300, 5, &blocks),
            (300, 5, &smooth),
            (129, 4, &both),
        ] {
            let normal = match n {
                17 | 2100 => sdf_field::Normal::Zero,
                _ => sdf_field::Normal::Computed,
            };
            let what = format!("{:?}, {:?}", grid.interpolation, grid.hash);
            let [kernel, reference] = both_sdf(&device, grid, n, active, normal);
            let name = format!("sdf_field, {what}");
            assert_close(&name, &kernel.0, &reference.0, VALUE_TOLERANCE);
            for (name, (a, b)) in ["table", "w1", "b1", "w2", "b2"]
                .iter()
                .zip(kernel.1.iter().zip(&reference.1))
            {
                assert_close(&format!("{name}, {what}"), a, b, GRADIENT_TOLERANCE);
            }
        }
    }
}

/// Two looks at 440 points in uneven parts, of which some are learnt from in another order.
#[test]
fn what_is_on_tape_is_not_computed_again_and_is_learnt_from() {
    for device in [Device::flex(), Device::ndarray()] {
        let device = device.autodiff();
        let layout = Arc::new(GridLayout::new(&config().grid));
        for (active, normal) in [
            (5, sdf_field::Normal::Computed),
            (3, sdf_field::Normal::Zero),
        ] {
            let surface = surface(&device);
            let weights = surface.sdf_weights();
            let settings = SdfFieldConfig {
                normal,
                ..surface.sdf_config(&layout, active, None)
            };
            let points = numbers(3 * 440, 51);
            let look = |points: &[f32], part: usize| -> TapedRows {
                let tape = Tape::default();
                for points in points.chunks(3 * part) {
                    let out = sdf_field::sdf_field(
                        tensor(points.to_vec(), [points.len() / 3, 3], &device).inner(),
                        constant(&weights),
                        SdfFieldConfig {
                            forward: Forward::Taped(tape.clone()),
                            ..settings.clone()
                        },
                    );
                    assert_eq!(out.dims(), [points.len() / 3, 11]);
                }
                tape.finish()
            };
            // Parts of 33 and of 150 points: tiles begin in the middle of some and end in others'.
            let (first, second) = points.split_at(3 * 210);
            let mut taped = look(first, 33);
            taped.append(&look(second, 150));
            assert_eq!(taped.len(), 440);
            let chosen: Vec<u32> = (0..440).rev().filter(|i| i % 3 != 0).collect();
            let n = chosen.len();
            let points: Vec<f32> = chosen
                .iter()
                .flat_map(|&i| points[3 * i as usize..][..3].to_vec())
                .collect();
            let learn = |forward: Forward, points: Vec<f32>| {
                let settings = SdfFieldConfig {
                    forward,
                    ..settings.clone()
                };
                let out = sdf_field::sdf_field(
                    tensor(points, [n, 3], &device),
                    weights.clone(),
                    settings,
                );
                let upstream = tensor(numbers(n * 11, 52), [n, 11], &device);
                let grads = out.clone().mul(upstream).sum().backward();
                (values(out), of_weights(&weights, &grads))
            };
            let alone = learn(Forward::Alone, points.clone());
            // Of no use to an op that computes nothing.
            let nowhere = vec![f32::NAN; points.len()];
            let from_tape = learn(Forward::FromTape(taped.select(&chosen)), nowhere);
            assert_eq!(alone.0, from_tape.0);
            for (i, (a, b)) in from_tape.1.iter().zip(&alone.1).enumerate() {
                // Sums over the points in another order.
                assert_close(&format!("gradient {i}"), a, b, 1e-5);
            }
            // What a GPU's tape has: nothing, so that everything is computed.
            let from_nothing = learn(Forward::FromTape(TapedRows::default()), points.clone());
            assert_eq!(alone, from_nothing);
        }
    }
}

/// The same weights outside autodiff.
fn constant(weights: &SdfFieldWeights) -> SdfFieldWeights {
    SdfFieldWeights {
        table: weights.table.clone().inner(),
        w1: weights.w1.clone().inner(),
        b1: weights.b1.clone().inner(),
        w2: weights.w2.clone().inner(),
        b2: weights.b2.clone().inner(),
    }
}

#[test]
fn colour_field_equals_its_reference() {
    for device in [Device::flex(), Device::ndarray()] {
        let device = &device.autodiff();
        for n in [1, 129, 1000] {
            let geometry = numbers(n * 11, 31);
            let upstream = numbers(n * 4, 32);
            let run = |reference: bool| {
                let surface = surface(device);
                let geometry = tensor(geometry.clone(), [n, 11], device).require_grad();
                let inputs = ColourFieldInputs {
                    geometry: geometry.clone(),
                    points: tensor(numbers(3 * n, 33), [n, 3], device),
                    directions: tensor(numbers(3 * n, 34), [n, 3], device),
                    extra: tensor(numbers(n, 35), [n, 1], device),
                };
                let weights = surface.colour_weights();
                let out = if reference {
                    colour_field::reference::colour_field(inputs, weights.clone())
                } else {
                    colour_field::colour_field(inputs, weights.clone())
                };
                let loss = out
                    .clone()
                    .mul(tensor(upstream.clone(), [n, 4], device))
                    .sum();
                let grads = loss.backward();
                let gradients = vec![
                    values(geometry.grad(&grads).unwrap()),
                    values(weights.w1.grad(&grads).unwrap()),
                    values(weights.b1.grad(&grads).unwrap()),
                    values(weights.w2.grad(&grads).unwrap()),
                    values(weights.b2.grad(&grads).unwrap()),
                    values(weights.w3.grad(&grads).unwrap()),
                    values(weights.b3.grad(&grads).unwrap()),
                ];
                (values(out), gradients)
            };
            let (kernel, reference) = (run(false), run(true));
            assert_close("colour_field", &kernel.0, &reference.0, VALUE_TOLERANCE);
            for (i, (a, b)) in kernel.1.iter().zip(&reference.1).enumerate() {
                assert_close(&format!("gradient {i}"), a, b, GRADIENT_TOLERANCE);
            }
        }
    }
}

/// Every way to read a field, with and without stretch; densities at the ends of their range.
#[test]
fn sample_rows_equal_their_reference() {
    let cases = [
        (Reading::Distance, 1.0, 0),
        (Reading::Distance, 0.25, 0),
        (Reading::Density, 0.0, 1),
        (Reading::Density, 1.0, 0),
    ];
    for device in [Device::flex(), Device::ndarray()] {
        let device = &device.autodiff();
        for ((reading, view_share, stretched), n) in cases.into_iter().zip([1, 129, 1000, 70]) {
            let mut geometry = numbers(n * 11, 51);
            for (row, raw) in geometry
                .chunks_exact_mut(11)
                .zip([20.0, -14.0, 0.0].iter().cycle())
            {
                row[0] += raw;
            }
            let upstream = numbers(n * 7, 52);
            let config = RowConfig {
                reading,
                view_share,
            };
            let run = |reference: bool| {
                let surface = surface(device);
                let geometry = tensor(geometry.clone(), [n, 11], device).require_grad();
                let inputs = ColourFieldInputs {
                    geometry: geometry.clone(),
                    points: tensor(numbers(3 * n, 53), [n, 3], device),
                    directions: tensor(numbers(3 * n, 54), [n, 3], device),
                    extra: tensor(numbers(n, 55), [n, 1], device),
                };
                let stretch: Vec<f32> =
                    numbers(stretched * n, 56).iter().map(|v| v.abs()).collect();
                let stretch = tensor(stretch, [n, stretched], device);
                let weights = surface.colour_weights();
                let out = if reference {
                    colour_field::reference::sample_rows(inputs, stretch, weights.clone(), config)
                } else {
                    colour_field::sample_rows(inputs, stretch, weights.clone(), config)
                };
                let upstream = tensor(upstream.clone(), [n, 7], device);
                let grads = out.clone().mul(upstream).sum().backward();
                let gradients = vec![
                    values(geometry.grad(&grads).unwrap()),
                    values(weights.w1.grad(&grads).unwrap()),
                    values(weights.b1.grad(&grads).unwrap()),
                    values(weights.w2.grad(&grads).unwrap()),
                    values(weights.b2.grad(&grads).unwrap()),
                    values(weights.w3.grad(&grads).unwrap()),
                    values(weights.b3.grad(&grads).unwrap()),
                ];
                (values(out), gradients)
            };
            let (kernel, reference) = (run(false), run(true));
            // Column by column: densities would drown the rest.
            for column in 0..7 {
                let of = |rows: &[f32], width: usize| -> Vec<f32> {
                    rows.iter().skip(column).step_by(width).copied().collect()
                };
                let name = format!("column {column}, {reading:?}");
                let (a, b) = (of(&kernel.0, 7), of(&reference.0, 7));
                assert_close(&name, &a, &b, VALUE_TOLERANCE);
            }
            for column in 0..11 {
                let of = |rows: &[f32]| -> Vec<f32> {
                    rows.iter().skip(column).step_by(11).copied().collect()
                };
                let name = format!("geometry {column}, {reading:?}");
                let (a, b) = (of(&kernel.1[0]), of(&reference.1[0]));
                assert_close(&name, &a, &b, GRADIENT_TOLERANCE);
            }
            for (i, (a, b)) in kernel.1.iter().zip(&reference.1).enumerate().skip(1) {
                assert_close(&format!("gradient {i}"), a, b, GRADIENT_TOLERANCE);
            }
        }
    }
}

#[test]
#[should_panic(expected = "the gradient does not fit the layout")]
fn a_gradient_of_another_layout_is_refused() {
    let device = Device::flex().autodiff();
    let (surface, layout) = (surface(&device), GridLayout::new(&config().grid));
    let larger = GridConfig {
        log2_table_size: 11,
        ..config().grid
    };
    let sparse = SparseGrad::new(&GridLayout::new(&larger));
    let settings = surface.sdf_config(&Arc::new(layout), 5, Some(sparse));
    let _ = sdf_field::sdf_field(
        tensor(numbers(3, 1), [1, 3], &device),
        surface.sdf_weights(),
        settings,
    );
}
