//! How visible each sample is, as plain numbers: without colours, and without a way back.

use rayon::prelude::*;

use super::{
    CompositeConfig, Packing, background_column,
    cpu::{Batch, CHUNK},
    object_column,
    survival::Logs,
};

/// How one sample is seen from its ray's origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Visibility {
    /// Its weight in the joint pixel, `w_F` or `w_B`.
    pub weight: f32,
    /// What both fields let through before it.
    pub transmittance: f32,
    /// What its own field lets through before it.
    pub alone: f32,
    /// What it takes of the light that reaches it, without the matte value: alpha.
    pub opacity: f32,
}

/// [`Visibility`] of the samples of both fields.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SampleVisibility {
    /// Of the object's rows; `[m_f]`.
    pub object: Vec<Visibility>,
    /// Of the background's rows; `[m_b]`.
    pub background: Vec<Visibility>,
}

/// What is left of a ray's light: shares of 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Through both fields.
    pub joint: f32,
    /// Through the object alone.
    pub object: f32,
    /// Through the background alone.
    pub background: f32,
}

impl Light {
    /// All of it, as at a ray's origin.
    pub const ALL: Self = Self {
        joint: 1.0,
        object: 1.0,
        background: 1.0,
    };
}

/// Weights and transmittances of all samples, as plain numbers: which of them light reaches at all,
/// and where a ray's surface lies.
///
/// `object` `[m_f, 6]` and `background` `[m_b, 5]` row-major, as for [`composite`](super::composite);
/// colours are not read.
///
/// # Panics
/// When a slice's length doesn't fit the packing.
pub fn sample_visibility(
    object: &[f32],
    background: &[f32],
    sharpness: [f32; 2],
    packing: &Packing,
    config: CompositeConfig,
) -> SampleVisibility {
    let mut light = vec![Light::ALL; packing.ray_count()];
    visibility_from(object, background, sharpness, packing, config, &mut light)
}

/// [`sample_visibility`] of stretches of rays that begin where only `light` `[rays]` is left, which
/// becomes what is left behind them.
///
/// Looking at a ray stretch by stretch gives the same bits as looking at it at once, and can stop
/// where nothing is left to be seen.
///
/// # Panics
/// When a slice's length doesn't fit the packing.
pub fn visibility_from(
    object: &[f32],
    background: &[f32],
    sharpness: [f32; 2],
    packing: &Packing,
    config: CompositeConfig,
    light: &mut [Light],
) -> SampleVisibility {
    assert_eq!(
        light.len(),
        packing.ray_count(),
        "visibility_from: light of {} rays, but the packing has {}",
        light.len(),
        packing.ray_count()
    );
    let batch = Batch {
        object,
        object_width: object_column::COUNT,
        background,
        background_width: background_column::COUNT,
        sharpness,
        packing,
        config,
    };
    batch.check();
    let mut out = SampleVisibility {
        object: vec![Visibility::default(); packing.object().len()],
        background: vec![Visibility::default(); packing.background().len()],
    };
    batch
        .split(&mut out.object, 1, &mut out.background, 1)
        .into_par_iter()
        .zip(light.par_chunks_mut(CHUNK))
        .for_each(|(part, light)| {
            let logs = Logs::of(&batch, part.rays.clone());
            for (ray, light) in part.rays.clone().zip(light) {
                let rest = batch.walk(ray, *light, &logs, |step| {
                    if let Some(row) = step.object_row {
                        part.object[row - part.object_start] = Visibility {
                            weight: step.object_weight(),
                            transmittance: step.joint,
                            alone: step.object_alone,
                            opacity: step.object_opacity(),
                        };
                    }
                    if let Some(row) = step.background_row {
                        part.background[row - part.background_start] = Visibility {
                            weight: step.background_weight(),
                            transmittance: step.joint,
                            alone: step.background_alone,
                            opacity: step.background_opacity(),
                        };
                    }
                });
                *light = rest.light;
            }
        });
    out
}
