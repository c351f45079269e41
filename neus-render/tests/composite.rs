//! The compositing op against the textbook in f64, finite differences, and the plain-tensor
//! reference, on every CPU backend.

// A test fails by panicking.
#![allow(clippy::unwrap_used)]
// Upstream marks burn-ndarray deprecated in favour of Flex; this workspace supports both.
#![allow(deprecated)]

mod oracle;

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use neus_render::{
    alpha::density_alpha,
    composite::{
        CompositeConfig, MatteRole, Packing, Transparency, Visibility, background_column, column,
        composite, composite_reference, object_column, sample_visibility,
    },
    random::unit_float,
};
use oracle::{Scene, random_scene};

/// Sums of some twenty products in single precision.
const VALUE_TOLERANCE: f64 = 3e-5;
/// Gradients carry the sharpness (about 10) and sums over a ray.
const GRADIENT_TOLERANCE: f64 = 5e-4;
/// Central differences in f64.
const DIFFERENCE: f64 = 1e-6;

fn devices() -> [(&'static str, Device); 2] {
    [("NdArray", Device::ndarray()), ("Flex", Device::flex())]
}

fn configs() -> Vec<CompositeConfig> {
    let base = CompositeConfig::default();
    vec![
        base,
        CompositeConfig {
            epsilon: 1e-5,
            ..base
        },
        CompositeConfig {
            matte: MatteRole::Unused,
            ..base
        },
        CompositeConfig {
            matte: MatteRole::Colour,
            background: Transparency::Density,
            ..base
        },
        CompositeConfig {
            cos_anneal: 0.3,
            ..base
        },
        CompositeConfig {
            background: Transparency::Density,
            ..base
        },
        CompositeConfig {
            object: Transparency::Density,
            cos_anneal: 0.0,
            epsilon: 1e-2,
            ..base
        },
    ]
}

#[derive(Clone, Copy)]
enum Which {
    Kernel,
    Reference,
}

/// Pixels and the gradients of `sum probe * pixels`, empty where there are none.
struct Outcome {
    pixels: Vec<f32>,
    object: Vec<f32>,
    background: Vec<f32>,
    sharpness: Vec<f32>,
}

fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_to_vec().unwrap()
}

/// Rows with a further column, which nobody is to read.
fn widened(values: &[f32], width: usize) -> Vec<f32> {
    let rows = values.chunks_exact(width);
    rows.flat_map(|row| row.iter().copied().chain([7e7]))
        .collect()
}

/// The gradient without that column, where it must be zero.
fn narrowed(gradient: Option<Tensor<2>>, width: usize) -> Vec<f32> {
    let gradient = gradient.map(numbers).unwrap_or_default();
    let mut out = Vec::new();
    for row in gradient.chunks_exact(width + 1) {
        assert_eq!(row[width], 0.0);
        out.extend_from_slice(&row[..width]);
    }
    out
}

fn run(scene: &Scene, probe: &[f32], device: &Device, which: Which) -> Outcome {
    let device = device.clone().autodiff();
    let (m_f, m_b) = (scene.object.len(), scene.background.len());
    let leaf = |values: Vec<f32>, shape: [usize; 2]| {
        Tensor::<2>::from_data(TensorData::new(values, shape), &device).require_grad()
    };
    let object = leaf(
        widened(&scene.object_f32(), object_column::COUNT),
        [m_f, object_column::COUNT + 1],
    );
    let background = leaf(
        widened(&scene.background_f32(), background_column::COUNT),
        [m_b, background_column::COUNT + 1],
    );
    let sharpness = Tensor::<1>::from_floats(scene.sharpness.map(|v| v as f32), &device);
    let sharpness = sharpness.require_grad();
    let inputs = (object.clone(), background.clone(), sharpness.clone());
    let pixels = match which {
        Which::Kernel => composite(
            inputs.0,
            inputs.1,
            inputs.2,
            Arc::new(scene.packing.clone()),
            scene.config,
        ),
        Which::Reference => {
            composite_reference(inputs.0, inputs.1, inputs.2, &scene.packing, scene.config)
        }
    };
    let shape = [scene.packing.ray_count(), column::COUNT];
    assert_eq!(pixels.dims(), shape);
    let probe = Tensor::<2>::from_data(TensorData::new(probe.to_vec(), shape), &device);
    let grads = (pixels.clone() * probe).sum().backward();
    Outcome {
        pixels: numbers(pixels),
        object: narrowed(object.grad(&grads), object_column::COUNT),
        background: narrowed(background.grad(&grads), background_column::COUNT),
        sharpness: sharpness.grad(&grads).map(numbers).unwrap_or_default(),
    }
}

fn probe_of(scene: &Scene, seed: u64) -> Vec<f32> {
    let count = (scene.packing.ray_count() * column::COUNT) as u64;
    (0..count).map(|i| unit_float(seed, i) - 0.5).collect()
}

#[track_caller]
fn assert_close(what: &str, found: &[f32], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}: lengths");
    for (i, (&a, &b)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(a) - b).abs() / (1.0 + b.abs());
        assert!(error < tolerance, "{what}[{i}]: {a} instead of {b}");
    }
}

fn widen(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&v| f64::from(v)).collect()
}

#[test]
fn pixels_equal_the_textbook_in_f64() {
    for (number, config) in configs().into_iter().enumerate() {
        let scene = random_scene(40, 14, config, number as u64);
        let expected: Vec<f64> = scene.pixels().into_iter().flatten().collect();
        let probe = probe_of(&scene, 1);
        for (name, device) in devices() {
            let found = run(&scene, &probe, &device, Which::Kernel);
            assert_close(name, &found.pixels, &expected, VALUE_TOLERANCE);
        }
    }
}

#[test]
fn gradients_equal_finite_differences_in_f64() {
    for (number, config) in configs().into_iter().enumerate() {
        let scene = random_scene(7, 9, config, 100 + number as u64);
        let probe = probe_of(&scene, 2);
        let difference = |change: &dyn Fn(&mut Scene, f64)| {
            let (mut up, mut down) = (scene.clone(), scene.clone());
            change(&mut up, DIFFERENCE);
            change(&mut down, -DIFFERENCE);
            (up.loss(&probe) - down.loss(&probe)) / (2.0 * DIFFERENCE)
        };
        let mut object = Vec::new();
        for row in 0..scene.object.len() {
            for c in 0..object_column::COUNT {
                object.push(difference(&|s, d| s.object[row][c] += d));
            }
        }
        let mut background = Vec::new();
        for row in 0..scene.background.len() {
            for c in 0..background_column::COUNT {
                background.push(difference(&|s, d| s.background[row][c] += d));
            }
        }
        let sharpness = [0, 1].map(|i| difference(&|s, d| s.sharpness[i] += d));
        let found = run(&scene, &probe, &Device::flex(), Which::Kernel);
        assert_close("object", &found.object, &object, GRADIENT_TOLERANCE);
        assert_close(
            "background",
            &found.background,
            &background,
            GRADIENT_TOLERANCE,
        );
        assert_close(
            "sharpness",
            &found.sharpness,
            &sharpness,
            GRADIENT_TOLERANCE,
        );
    }
}

#[test]
fn kernel_and_reference_agree_on_every_backend() {
    for (number, config) in configs().into_iter().enumerate() {
        let scene = random_scene(50, 20, config, 200 + number as u64);
        let probe = probe_of(&scene, 3);
        for (name, device) in devices() {
            let kernel = run(&scene, &probe, &device, Which::Kernel);
            let reference = run(&scene, &probe, &device, Which::Reference);
            for (what, a, b, tolerance) in [
                ("pixels", kernel.pixels, reference.pixels, VALUE_TOLERANCE),
                (
                    "object",
                    kernel.object,
                    reference.object,
                    GRADIENT_TOLERANCE,
                ),
                (
                    "background",
                    kernel.background,
                    reference.background,
                    GRADIENT_TOLERANCE,
                ),
                (
                    "sharpness",
                    kernel.sharpness,
                    reference.sharpness,
                    GRADIENT_TOLERANCE,
                ),
            ] {
                assert_close(&format!("{name} {what}"), &a, &widen(&b), tolerance);
            }
        }
    }
}

#[test]
fn backends_agree_to_the_bit() {
    let scene = random_scene(64, 30, CompositeConfig::default(), 5);
    let probe = probe_of(&scene, 4);
    let [a, b] = devices().map(|(_, device)| run(&scene, &probe, &device, Which::Kernel));
    assert_eq!(a.pixels, b.pixels);
    assert_eq!(a.object, b.object);
    assert_eq!(a.background, b.background);
    assert_eq!(a.sharpness, b.sharpness);
}

#[test]
fn rays_without_intervals_are_zero_and_have_finite_gradients() {
    for (name, device) in devices() {
        let scene = Scene {
            object: vec![],
            background: vec![],
            sharpness: [10.0, 10.0],
            packing: Packing::new(vec![0, 0, 0, 0], vec![], vec![], vec![], vec![]),
            config: CompositeConfig::default(),
        };
        for which in [Which::Kernel, Which::Reference] {
            let found = run(&scene, &[1.0; 3 * column::COUNT], &device, which);
            assert!(found.pixels.iter().all(|&v| v == 0.0), "{name}");
            assert!(found.sharpness.iter().all(|&v| v == 0.0), "{name}");
        }
    }
}

/// Far inside, far outside, zero and huge sharpness, grazing, matte values at both ends.
#[test]
fn extreme_samples_give_finite_values_and_gradients() {
    let sdf = [-1e4, -3.0, -1e-3, 0.0, 1e-3, 3.0, 1e4, 1e-40];
    let slope = [-1.0, -0.0, 0.0, 1.0, 1e-30, -1e3];
    let mut object = Vec::new();
    let mut background = Vec::new();
    for &d in &sdf {
        for &v in &slope {
            for matte in [0.0, 1.0, 0.5, 1.0 - 1e-7] {
                object.push([d, v, 1.0, 0.5, 0.0, matte]);
                background.push([d, v, 1.0, 0.5, 0.0]);
            }
        }
    }
    let n = object.len() as u32;
    for epsilon in [0.0, 1e-5] {
        for s in [0.0, 1.0, 1e3, 1e7] {
            let t = (0..n).map(|i| i as f32).collect();
            // One ray per sample, so that none hides behind another, and one ray through all.
            for offsets in [(0..=n).collect(), vec![0, n]] {
                let rays = offsets.len() - 1;
                let scene = Scene {
                    object: object.clone(),
                    background: background.clone(),
                    sharpness: [s, s],
                    packing: Packing::new(
                        offsets,
                        Vec::clone(&t),
                        vec![0.1; n as usize],
                        (0..n).collect(),
                        (0..n).collect(),
                    ),
                    config: CompositeConfig {
                        epsilon,
                        ..CompositeConfig::default()
                    },
                };
                let probe = vec![1.0; rays * column::COUNT];
                let found = run(&scene, &probe, &Device::flex(), Which::Kernel);
                for values in [
                    found.pixels,
                    found.object,
                    found.background,
                    found.sharpness,
                ] {
                    assert!(
                        values.iter().all(|v| v.is_finite()),
                        "s {s}, epsilon {epsilon}"
                    );
                }
            }
        }
    }
}

/// A broken field must not pass for empty space: its pixel and gradients are no numbers, those of other rays are.
#[test]
fn a_sample_that_is_no_number_is_not_empty_space() {
    for config in configs() {
        let clean = Scene {
            object: vec![[0.1, -0.5, 0.2, 0.3, 0.4, 0.9]; 2],
            background: vec![[0.1, -0.5, 0.2, 0.3, 0.4]; 2],
            sharpness: [10.0, 10.0],
            packing: Packing::new(
                vec![0, 1, 2],
                vec![1.0, 1.0],
                vec![0.1, 0.1],
                vec![0, 1],
                vec![0, 1],
            ),
            config,
        };
        let probe = vec![1.0; 2 * column::COUNT];
        let check = |spoilt: &Scene, kind: Transparency, column: usize, opacity: usize| {
            // Densities have no slope.
            if column == object_column::SLOPE && kind == Transparency::Density {
                return;
            }
            let found = run(spoilt, &probe, &Device::flex(), Which::Kernel);
            let (broken, sound) = found.pixels.split_at(column::COUNT);
            for i in [opacity, column::JOINT_OPACITY, column::JOINT_COLOUR] {
                assert!(broken[i].is_nan(), "column {i} by {column}, {config:?}");
            }
            assert!(sound.iter().all(|v| v.is_finite()));
            for gradient in [found.object, found.background] {
                let (broken, sound) = gradient.split_at(gradient.len() / 2);
                assert!(broken[object_column::SDF].is_nan());
                assert!(sound.iter().all(|v| v.is_finite()));
            }
        };
        for column in [object_column::SDF, object_column::SLOPE] {
            let (mut object, mut background) = (clean.clone(), clean.clone());
            object.object[0][column] = f64::NAN;
            check(&object, config.object, column, column::OBJECT_OPACITY);
            background.background[0][column] = f64::NAN;
            let opacity = column::BACKGROUND_OPACITY;
            check(&background, config.background, column, opacity);
        }
    }
    assert!(density_alpha(f32::NAN, 0.1).is_nan());
}

#[test]
fn weights_are_the_gradient_of_colours() {
    let scene = random_scene(20, 10, CompositeConfig::default(), 9);
    let seen = sample_visibility(
        &scene.object_f32(),
        &scene.background_f32(),
        scene.sharpness.map(|v| v as f32),
        &scene.packing,
        scene.config,
    );
    // A probe of one on the joint red makes the gradient of a sample's red its weight.
    let mut probe = vec![0.0; scene.packing.ray_count() * column::COUNT];
    for pixel in probe.chunks_mut(column::COUNT) {
        pixel[column::JOINT_COLOUR] = 1.0;
    }
    let found = run(&scene, &probe, &Device::flex(), Which::Kernel);
    let red = |gradient: &[f32], columns: usize| -> Vec<f32> {
        gradient.chunks(columns).map(|row| row[2]).collect()
    };
    let weights = |of: &[Visibility]| -> Vec<f32> { of.iter().map(|v| v.weight).collect() };
    assert_eq!(weights(&seen.object), red(&found.object, 6));
    assert_eq!(weights(&seen.background), red(&found.background, 5));
    // What is let through before a sample never rises along a ray, and is 1 at its start.
    let packing = &scene.packing;
    for (of, offsets) in [
        (&seen.object, packing.object_offsets()),
        (&seen.background, packing.background_offsets()),
    ] {
        for ray in offsets.windows(2) {
            let ray = &of[ray[0] as usize..ray[1] as usize];
            assert!(ray.first().is_none_or(|first| first.alone == 1.0));
            assert!(ray.is_sorted_by(|a, b| a.alone >= b.alone));
            assert!(ray.iter().all(|v| v.transmittance <= v.alone));
        }
    }
    // What a sample's opacity takes is what its field lacks before the next; the background has no matte value.
    for ray in packing.background_offsets().windows(2) {
        let ray = &seen.background[ray[0] as usize..ray[1] as usize];
        for pair in ray.windows(2) {
            let left = pair[0].alone * (1.0 - pair[0].opacity);
            assert!((left - pair[1].alone).abs() < 1e-5);
        }
    }
    // The object's may take more than its matte value lets it.
    for ray in packing.object_offsets().windows(2) {
        let ray = &seen.object[ray[0] as usize..ray[1] as usize];
        for pair in ray.windows(2) {
            let left = pair[0].alone * (1.0 - pair[0].opacity);
            assert!(left < pair[1].alone + 1e-5);
        }
    }
}

/// A half-transparent matte at the first surface lets the background through in front-to-back
/// order: what stands before the object hides it.
#[test]
fn depth_order_decides_who_hides_whom() {
    let config = CompositeConfig {
        object: Transparency::Density,
        background: Transparency::Density,
        ..CompositeConfig::default()
    };
    // Intervals: background at half opacity, object with matte .8 and opaque, background opaque.
    let half = std::f64::consts::LN_2;
    let scene = Scene {
        object: vec![[1e3, 0.0, 1.0, 0.0, 0.0, 0.8]],
        background: vec![[half, 0.0, 0.0, 1.0, 0.0], [1e3, 0.0, 0.0, 0.0, 1.0]],
        sharpness: [1.0, 1.0],
        packing: Packing::new(
            vec![0, 3],
            vec![1.0, 2.0, 3.0],
            vec![1.0; 3],
            vec![1],
            vec![0, 2],
        ),
        config,
    };
    let found = run(
        &scene,
        &[1.0; column::COUNT],
        &Device::flex(),
        Which::Kernel,
    );
    let near = |i: usize, expected: f32| {
        assert!((found.pixels[i] - expected).abs() < 1e-5, "column {i}");
    };
    near(column::JOINT_COLOUR, 0.4);
    near(column::JOINT_COLOUR + 1, 0.5);
    near(column::JOINT_COLOUR + 2, 0.1);
    near(column::MATTE, 0.4);
    near(column::OBJECT_OPACITY, 0.8);
    near(column::OBJECT_COLOUR, 0.8);
    near(column::BACKGROUND_COLOUR + 2, 0.5);
    near(column::JOINT_OPACITY, 1.0);
    near(column::JOINT_DEPTH, 0.5 + 0.8 + 0.3);
}

#[test]
#[should_panic(expected = "composite: object has shape [2, 6], the packing wants [1, 6]")]
fn a_wrong_shape_names_op_argument_and_shapes() {
    let device = Device::flex();
    let packing = Packing::new(vec![0, 1], vec![1.0], vec![0.1], vec![0], vec![]);
    composite(
        Tensor::zeros([2, 6], &device),
        Tensor::zeros([0, 5], &device),
        Tensor::zeros([2], &device),
        Arc::new(packing),
        CompositeConfig::default(),
    );
}
