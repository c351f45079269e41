//! `composite`: pixels and the gradients of samples and sharpnesses.

use std::sync::Arc;

use burn::tensor::Device;
use neus_render::composite::{
    CompositeConfig, Marks, MatteRole, Packing, Transparency, background_column, column, composite,
    composite_reference, object_column,
};

use crate::support::{
    GRADIENT, Random, VALUE, assert_close, assert_columns_close, gpu, numbers, oracle, tensor,
};

#[derive(Clone)]
struct Scene {
    packing: Packing,
    object: Vec<f32>,
    background: Vec<f32>,
}

/// Rays of up to 40 intervals, some without any; samples of either field in most of them.
fn scene(rays: usize) -> Scene {
    scene_of(rays, |ray, unit| {
        if ray % 7 == 3 {
            0
        } else {
            (40.0 * unit) as usize
        }
    })
}

/// Rays of as many intervals as `count` says for a ray and a number between 0 and 1.
fn scene_of(rays: usize, count: impl Fn(usize, f32) -> usize) -> Scene {
    let mut random = Random(rays as u32 + 17);
    let mut unit = move || 0.5 * (random.signed() + 1.0);
    let (mut offsets, mut t, mut dt) = (vec![0], Vec::new(), Vec::new());
    let (mut object, mut background) = (Vec::new(), Vec::new());
    let (mut of_object, mut of_background) = (Vec::new(), Vec::new());
    for ray in 0..rays {
        let intervals = count(ray, unit());
        // Long rays are as long as others, or nothing is seen behind their first intervals.
        let share = 40.0 / intervals.max(40) as f32;
        let mut at = 1.0 + unit();
        for _ in 0..intervals {
            let length = share * (0.02 + 0.05 * unit());
            let i = t.len() as u32;
            t.push(at);
            dt.push(length);
            at += length;
            // Falling through zero and below, at some slope.
            if unit() < 0.7 {
                of_object.push(i);
                let matte = 0.05 + 0.9 * unit();
                object.extend([0.8 - 0.3 * at + 0.2 * unit(), 1.2 - 2.4 * unit()]);
                object.extend([unit(), unit(), unit(), matte]);
            }
            if unit() < 0.6 {
                of_background.push(i);
                background.extend([0.9 - 0.3 * at + 0.3 * unit(), 1.2 - 2.4 * unit()]);
                background.extend([unit(), unit(), unit()]);
            }
        }
        offsets.push(t.len() as u32);
    }
    let mut marks = |count: usize| (0..count).map(|_| [unit() - 0.3, unit()]).collect();
    let marks = Marks {
        object: marks(of_object.len()),
        background: marks(of_background.len()),
    };
    Scene {
        packing: Packing::new(offsets, t, dt, of_object, of_background).with_marks(marks),
        object,
        background,
    }
}

/// Rows with a further column, which nobody reads.
fn widened(rows: &[f32], columns: usize) -> Vec<f32> {
    let rows = rows.chunks_exact(columns);
    rows.flat_map(|row| row.iter().copied().chain([3.0]))
        .collect()
}

/// Pixels, then the gradients of object, background and sharpness.
fn run(scene: &Scene, config: CompositeConfig, device: &Device, kernel: bool) -> Vec<Vec<f64>> {
    let device = &device.clone().autodiff();
    let shape = |values: &[f32], columns: usize| [values.len() / columns, columns];
    let leaf = |rows: &[f32], columns: usize| {
        let rows = widened(rows, columns);
        tensor(&rows, shape(&rows, columns + 1), device).require_grad()
    };
    let object = leaf(&scene.object, object_column::COUNT);
    let background = leaf(&scene.background, background_column::COUNT);
    let sharpness = tensor(&[12.0, 9.0], [2], device).require_grad();
    let inputs = (object.clone(), background.clone(), sharpness.clone());
    let pixels = if kernel {
        let packing = Arc::new(scene.packing.clone());
        composite(inputs.0, inputs.1, inputs.2, packing, config)
    } else {
        composite_reference(inputs.0, inputs.1, inputs.2, &scene.packing, config)
    };
    let rays = scene.packing.ray_count();
    let probe = tensor(
        &Random(3).list(rays * column::COUNT),
        [rays, column::COUNT],
        device,
    );
    let grads = (pixels.clone() * probe).sum().backward();
    vec![
        numbers(pixels),
        object.grad(&grads).map(numbers).unwrap_or_default(),
        background.grad(&grads).map(numbers).unwrap_or_default(),
        sharpness.grad(&grads).map(numbers).unwrap_or_default(),
    ]
}

/// What [`run`] returns, and columns of each.
const PARTS: [(&str, usize); 4] = [
    ("pixels", column::COUNT),
    ("object", object_column::COUNT + 1),
    ("background", background_column::COUNT + 1),
    ("sharpness", 1),
];

fn configs() -> [CompositeConfig; 6] {
    let base = CompositeConfig::default();
    [
        base,
        CompositeConfig {
            epsilon: 1e-3,
            cos_anneal: 0.3,
            ..base
        },
        CompositeConfig {
            matte: MatteRole::Unused,
            ..base
        },
        CompositeConfig {
            matte: MatteRole::Colour,
            ..base
        },
        CompositeConfig {
            background: Transparency::Density,
            ..base
        },
        CompositeConfig {
            object: Transparency::Density,
            ..base
        },
    ]
}

#[test]
fn pixels_and_gradients_are_the_references() {
    let Some(gpu) = gpu() else {
        return;
    };
    // A workgroup takes 64 intervals of a ray at a time.
    let long = [0, 1, 63, 64, 65, 127, 128, 129, 300];
    let scenes = [1, 65, 300].map(scene);
    for scene in scenes
        .into_iter()
        .chain([scene_of(long.len(), |ray, _| long[ray])])
    {
        let rays = scene.packing.ray_count();
        for config in configs() {
            let found = run(&scene, config, &gpu, true);
            let expected = run(&scene, config, &oracle(), false);
            let parts = PARTS.iter().zip(&found).zip(&expected);
            for (((name, columns), found), expected) in parts {
                let tolerance = if *name == "pixels" { VALUE } else { GRADIENT };
                let what = format!("{name}, {rays} rays, {config:?}");
                assert_columns_close(&what, found, expected, *columns, tolerance);
            }
        }
    }
}

#[test]
fn fields_and_rays_may_be_empty() {
    let Some(gpu) = gpu() else {
        return;
    };
    // Two rays, the second without intervals; no sample of either field.
    let nothing = Scene {
        packing: Packing::new(vec![0, 2, 2], vec![1.0, 2.0], vec![1.0; 2], vec![], vec![]),
        object: vec![],
        background: vec![],
    };
    let found = run(&nothing, CompositeConfig::default(), &gpu, true);
    assert_eq!(found[0], vec![0.0; 2 * column::COUNT]);
    assert_eq!(found[3], vec![0.0; 2]);
    // One field alone, as the background is while a run begins.
    let mut scene = scene(20);
    scene.object.clear();
    scene.packing = Packing::new(
        scene.packing.ray_offsets().to_vec(),
        scene.packing.t().to_vec(),
        scene.packing.dt().to_vec(),
        vec![],
        scene.packing.background().to_vec(),
    );
    let found = run(&scene, CompositeConfig::default(), &gpu, true);
    let expected = run(&scene, CompositeConfig::default(), &Device::flex(), true);
    for (found, expected) in found.iter().zip(&expected) {
        assert_close("the background alone", found, expected, VALUE);
    }
}

/// An opaque wall in single precision: gradients stay finite.
#[test]
fn opaque_samples_have_finite_gradients() {
    let Some(gpu) = gpu() else {
        return;
    };
    let mut scene = scene(30);
    for row in scene.object.chunks_exact_mut(object_column::COUNT) {
        row[object_column::SDF] *= 500.0;
        row[object_column::MATTE] = 1.0;
    }
    let found = run(&scene, CompositeConfig::default(), &gpu, true);
    let expected = run(&scene, CompositeConfig::default(), &Device::flex(), true);
    for (found, expected) in found.iter().zip(&expected) {
        assert!(found.iter().all(|value| value.is_finite()));
        assert_close("a wall", found, expected, GRADIENT);
    }
}

/// A sample that is no number spoils its ray: neither other pixels nor other rays' gradients.
#[test]
fn a_sample_that_is_no_number_spoils_its_own_ray_alone() {
    let Some(gpu) = gpu() else {
        return;
    };
    let clean = scene(130);
    let ray = 70;
    let rows_of = |offsets: &[u32]| offsets[ray] as usize..offsets[ray + 1] as usize;
    let objects = rows_of(clean.packing.object_offsets());
    let backgrounds = rows_of(clean.packing.background_offsets());
    assert!(objects.len() > 2 && !backgrounds.is_empty());
    let mut spoilt = clean.clone();
    let at = (objects.start + 1) * object_column::COUNT;
    spoilt.object[at + object_column::SDF] = f32::NAN;
    for config in configs() {
        let (found, without) = (
            run(&spoilt, config, &gpu, true),
            run(&clean, config, &gpu, true),
        );
        let of_ray = [ray..ray + 1, objects.clone(), backgrounds.clone()];
        for (i, rows) in of_ray.into_iter().enumerate() {
            let (name, columns) = PARTS[i];
            let others = |values: &[f64]| -> Vec<f64> {
                let (before, after) = (columns * rows.start, columns * rows.end);
                [&values[..before], &values[after..]].concat()
            };
            let (found, without) = (others(&found[i]), others(&without[i]));
            assert!(found.iter().all(|value| value.is_finite()), "{name}");
            assert!(found == without, "{name}, {config:?}");
        }
    }
}
