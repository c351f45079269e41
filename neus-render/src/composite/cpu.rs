//! The kernel over plain slices, forward and backward, parallel over rays.
//!
//! Both directions walk a ray once from front to back. Backward then goes from back to front with
//! the sums of what later intervals contribute: with `l = log(1 - a)`, a later weight's derivative
//! is the weight itself, so no division by `1 - a` is needed.

use rayon::prelude::*;
use tensor_slices::Stopwatch;

use super::{
    CompositeConfig, LEAST_SURVIVAL, MatteRole, Packing, background_column, column, object_column,
    opacity::{Kernel, Opacity},
    survival::Logs,
    visibility::Light,
};
use crate::alpha::NeusParameters;

/// Rays that one task handles.
pub(super) const CHUNK: usize = 32;

/// A batch as slices; see [`composite`](super::composite) for the shapes.
#[derive(Clone, Copy)]
pub(crate) struct Batch<'a> {
    pub(crate) object: &'a [f32],
    /// Columns of `object`.
    pub(crate) object_width: usize,
    pub(crate) background: &'a [f32],
    /// Columns of `background`.
    pub(crate) background_width: usize,
    pub(crate) sharpness: [f32; 2],
    pub(crate) packing: &'a Packing,
    pub(crate) config: CompositeConfig,
}

/// Gradients with respect to the three tensors, row-major like them.
pub(crate) struct Gradients {
    pub(crate) object: Vec<f32>,
    pub(crate) background: Vec<f32>,
    pub(crate) sharpness: [f32; 2],
}

/// Time spent in forward passes.
pub static FORWARD: Stopwatch = Stopwatch::new();
/// Time spent in backward passes.
pub static BACKWARD: Stopwatch = Stopwatch::new();

/// Pixels of all rays: `[rays, 20]` row-major.
pub(crate) fn forward(batch: &Batch<'_>) -> Vec<f32> {
    let _lap = FORWARD.lap();
    batch.check();
    let mut out = vec![0.0; batch.packing.ray_count() * column::COUNT];
    out.par_chunks_mut(CHUNK * column::COUNT)
        .enumerate()
        .for_each(|(chunk, out)| {
            let first = chunk * CHUNK;
            let logs = Logs::of(batch, first..first + out.len() / column::COUNT);
            for (i, pixel) in out.chunks_exact_mut(column::COUNT).enumerate() {
                batch.render(first + i, &logs, pixel);
            }
        });
    out
}

/// Gradients of all inputs from that of the pixels, `grad` `[rays, 20]`.
pub(crate) fn backward(batch: &Batch<'_>, grad: &[f32]) -> Gradients {
    let _lap = BACKWARD.lap();
    batch.check();
    let mut object = vec![0.0; batch.object.len()];
    let mut background = vec![0.0; batch.background.len()];
    let parts: Vec<[f64; 2]> = batch
        .split(
            &mut object,
            batch.object_width,
            &mut background,
            batch.background_width,
        )
        .into_par_iter()
        .map_init(Vec::new, |steps, mut part| {
            let mut sharpness = [0.0; 2];
            let logs = Logs::of(batch, part.rays.clone());
            for ray in part.rays.clone() {
                let grad = &grad[ray * column::COUNT..(ray + 1) * column::COUNT];
                let sums = batch.ray_backward(ray, &logs, grad, steps, &mut part);
                sharpness[0] += sums[0];
                sharpness[1] += sums[1];
            }
            sharpness
        })
        .collect();
    // Summed in order, so that results don't depend on the number of threads.
    let sharpness = parts
        .iter()
        .fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]]);
    Gradients {
        object,
        background,
        sharpness: sharpness.map(|v| v as f32),
    }
}

/// One interval on the way along a ray; transmittances are those before it.
pub(super) struct Step {
    interval: usize,
    pub(super) object_row: Option<usize>,
    pub(super) background_row: Option<usize>,
    object: Opacity,
    background: Opacity,
    pub(super) joint: f32,
    pub(super) object_alone: f32,
    pub(super) background_alone: f32,
}

impl Step {
    #[inline]
    pub(super) fn object_weight(&self) -> f32 {
        self.joint * self.object.alpha * (1.0 - 0.5 * self.background.alpha)
    }

    #[inline]
    pub(super) fn background_weight(&self) -> f32 {
        self.joint * self.background.alpha * (1.0 - 0.5 * self.object.alpha)
    }

    #[inline]
    pub(super) fn object_opacity(&self) -> f32 {
        self.object.bare_alpha
    }

    #[inline]
    pub(super) fn background_opacity(&self) -> f32 {
        self.background.bare_alpha
    }
}

/// Transmittances of a whole ray.
pub(super) struct Remainder {
    pub(super) light: Light,
    object_log: f32,
}

/// Consecutive rays and their rows of two per-sample arrays.
pub(super) struct Part<'a, T = f32> {
    pub(super) rays: std::ops::Range<usize>,
    pub(super) object: &'a mut [T],
    pub(super) object_start: usize,
    pub(super) background: &'a mut [T],
    pub(super) background_start: usize,
}

impl<'a> Batch<'a> {
    pub(super) fn check(&self) {
        for (name, values, rows, width, least) in [
            (
                "object",
                self.object,
                self.packing.object(),
                self.object_width,
                object_column::COUNT,
            ),
            (
                "background",
                self.background,
                self.packing.background(),
                self.background_width,
                background_column::COUNT,
            ),
        ] {
            assert!(
                width >= least && values.len() == rows.len() * width,
                "composite: {name} has {} values in rows of {width}, the packing wants {} rows of \
                 {least} or more",
                values.len(),
                rows.len()
            );
        }
    }

    /// Cuts two per-sample arrays (of so many values per row) along chunks of rays.
    pub(super) fn split<'b, T>(
        &self,
        mut object: &'b mut [T],
        object_width: usize,
        mut background: &'b mut [T],
        background_width: usize,
    ) -> Vec<Part<'b, T>> {
        let rays = self.packing.ray_count();
        let rows = |offsets: &[u32], rays: &std::ops::Range<usize>| {
            let (start, end) = (offsets[rays.start] as usize, offsets[rays.end] as usize);
            (start, end - start)
        };
        (0..rays)
            .step_by(CHUNK)
            .map(|start| {
                let rays = start..(start + CHUNK).min(rays);
                let (object_start, n) = rows(self.packing.object_offsets(), &rays);
                let (object_part, rest) =
                    std::mem::take(&mut object).split_at_mut(n * object_width);
                object = rest;
                let (background_start, n) = rows(self.packing.background_offsets(), &rays);
                let (background_part, rest) =
                    std::mem::take(&mut background).split_at_mut(n * background_width);
                background = rest;
                Part {
                    rays,
                    object: object_part,
                    object_start,
                    background: background_part,
                    background_start,
                }
            })
            .collect()
    }

    fn neus(&self, sharpness: f32) -> NeusParameters {
        NeusParameters {
            sharpness,
            cos_anneal: self.config.cos_anneal,
            epsilon: self.config.epsilon,
        }
    }

    /// Of object and background.
    pub(super) fn kernels(&self) -> [Kernel; 2] {
        [
            Kernel::new(self.config.object, self.neus(self.sharpness[0])),
            Kernel::new(self.config.background, self.neus(self.sharpness[1])),
        ]
    }

    /// Visits the intervals of a ray, one of those that `logs` is of, from front to back.
    #[inline]
    pub(super) fn walk(
        &self,
        ray: usize,
        light: Light,
        logs: &Logs,
        mut visit: impl FnMut(Step),
    ) -> Remainder {
        let packing = self.packing;
        let mut object_row = packing.object_offsets()[ray] as usize;
        let object_end = packing.object_offsets()[ray + 1] as usize;
        let mut background_row = packing.background_offsets()[ray] as usize;
        let background_end = packing.background_offsets()[ray + 1] as usize;
        let mut rest = Remainder {
            light,
            object_log: 0.0,
        };
        let range = packing.ray_offsets()[ray] as usize..packing.ray_offsets()[ray + 1] as usize;
        for interval in range {
            let mut step = Step {
                interval,
                object_row: None,
                background_row: None,
                object: Opacity::NONE,
                background: Opacity::NONE,
                joint: rest.light.joint,
                object_alone: rest.light.object,
                background_alone: rest.light.background,
            };
            if object_row < object_end && packing.object()[object_row] as usize == interval {
                let row = &self.object[object_row * self.object_width..];
                let log = logs.object(object_row);
                let matte = match self.config.matte {
                    MatteRole::Opacity => row[object_column::MATTE],
                    MatteRole::Unused | MatteRole::Colour => 1.0,
                };
                step.object = Opacity::new(log, matte);
                step.object_row = Some(object_row);
                object_row += 1;
            }
            if background_row < background_end
                && packing.background()[background_row] as usize == interval
            {
                let log = logs.background(background_row);
                step.background = Opacity::new(log, 1.0);
                step.background_row = Some(background_row);
                background_row += 1;
            }
            let light = &mut rest.light;
            light.joint *= step.object.survival * step.background.survival;
            light.object *= step.object.survival;
            light.background *= step.background.survival;
            rest.object_log += step.object.log;
            visit(step);
        }
        rest
    }

    fn render(&self, ray: usize, logs: &Logs, pixel: &mut [f32]) {
        let rest = self.walk(ray, Light::ALL, logs, |step| {
            let t = self.packing.t()[step.interval];
            let (w_f, w_b) = (step.object_weight(), step.background_weight());
            if let Some(row) = step.object_row {
                let colour = self.object_colour(row);
                let alone = step.object_alone * step.object.alpha;
                let head = self.head(row);
                let (held, held_alone) = (w_f * head, alone * head);
                for c in 0..3 {
                    pixel[column::JOINT_COLOUR + c] += held * colour[c];
                    pixel[column::OBJECT_COLOUR + c] += held_alone * colour[c];
                }
                if self.config.matte == MatteRole::Colour {
                    pixel[column::HEAD] += held;
                    pixel[column::HEAD_ALONE] += held_alone;
                }
                pixel[column::MATTE] += w_f;
                pixel[column::OBJECT_DEPTH] += alone * t;
                if let Some(marks) = self.packing.marks() {
                    pixel[column::MARKS] += w_f * marks.object[row][0];
                    pixel[column::MARKS + 1] += w_f * marks.object[row][1];
                }
            }
            if let Some(row) = step.background_row {
                let colour = self.background_colour(row);
                let alone = step.background_alone * step.background.alpha;
                for c in 0..3 {
                    pixel[column::JOINT_COLOUR + c] += w_b * colour[c];
                    pixel[column::BACKGROUND_COLOUR + c] += alone * colour[c];
                }
                if let Some(marks) = self.packing.marks() {
                    pixel[column::MARKS] += w_b * marks.background[row][0];
                    pixel[column::MARKS + 1] += w_b * marks.background[row][1];
                }
            }
            pixel[column::JOINT_DEPTH] += (w_f + w_b) * t;
        });
        pixel[column::OBJECT_OPACITY] = 1.0 - rest.light.object;
        pixel[column::BACKGROUND_OPACITY] = 1.0 - rest.light.background;
        pixel[column::JOINT_OPACITY] = 1.0 - rest.light.joint;
        pixel[column::OBJECT_LOG_TRANSMITTANCE] = rest.object_log;
    }

    #[inline]
    fn object_colour(&self, row: usize) -> &[f32] {
        let at = row * self.object_width + object_column::COLOUR;
        &self.object[at..at + 3]
    }

    /// What an object's colour is multiplied by.
    #[inline]
    fn head(&self, row: usize) -> f32 {
        match self.config.matte {
            MatteRole::Colour => self.object[row * self.object_width + object_column::MATTE],
            MatteRole::Unused | MatteRole::Opacity => 1.0,
        }
    }

    #[inline]
    fn background_colour(&self, row: usize) -> &[f32] {
        let at = row * self.background_width + background_column::COLOUR;
        &self.background[at..at + 3]
    }

    /// Writes a ray's rows of the gradients and returns its part of the sharpnesses'.
    fn ray_backward(
        &self,
        ray: usize,
        logs: &Logs,
        grad: &[f32],
        steps: &mut Vec<Step>,
        part: &mut Part<'_>,
    ) -> [f64; 2] {
        steps.clear();
        let rest = self.walk(ray, Light::ALL, logs, |step| steps.push(step));
        let rest = rest.light;
        let kernels = self.kernels();
        let g_joint = &grad[column::JOINT_COLOUR..column::JOINT_COLOUR + 3];
        let g_object = &grad[column::OBJECT_COLOUR..column::OBJECT_COLOUR + 3];
        let g_background = &grad[column::BACKGROUND_COLOUR..column::BACKGROUND_COLOUR + 3];
        // Loss per unit of log(1 - a) through what lies behind, with the opacities' share first.
        let mut behind_joint = -grad[column::JOINT_OPACITY] * rest.joint;
        let mut behind_object = -grad[column::OBJECT_OPACITY] * rest.object;
        let mut behind_background = -grad[column::BACKGROUND_OPACITY] * rest.background;
        let g_log = grad[column::OBJECT_LOG_TRANSMITTANCE];
        let (g_head, g_head_alone) = match self.config.matte {
            MatteRole::Colour => (grad[column::HEAD], grad[column::HEAD_ALONE]),
            MatteRole::Unused | MatteRole::Opacity => (0.0, 0.0),
        };
        let g_marks = &grad[column::MARKS..column::MARKS + 2];
        let marks = self.packing.marks();
        let mut sharpness = [0.0; 2];
        for step in steps.iter().rev() {
            let t = self.packing.t()[step.interval];
            let dt = self.packing.dt()[step.interval];
            let (a_f, a_b) = (step.object.alpha, step.background.alpha);
            let g_depth = grad[column::JOINT_DEPTH] * t;
            // Loss per unit of the weights: w_F, w_B, and of each field alone.
            let (mut per_f, mut per_f_alone) = (0.0, 0.0);
            let (mut per_head, mut per_head_alone) = (0.0, 0.0);
            if let Some(row) = step.object_row {
                let colour = self.object_colour(row);
                let head = self.head(row);
                per_head = dot(g_joint, colour) + g_head;
                per_head_alone = dot(g_object, colour) + g_head_alone;
                per_f = g_depth + grad[column::MATTE] + head * per_head;
                per_f_alone = grad[column::OBJECT_DEPTH] * t + head * per_head_alone;
                if let Some(marks) = marks {
                    let mark = marks.object[row];
                    per_f += g_marks[0] * mark[0] + g_marks[1] * mark[1];
                }
            }
            let (mut per_b, mut per_b_alone) = (0.0, 0.0);
            if let Some(row) = step.background_row {
                let colour = self.background_colour(row);
                per_b = g_depth + dot(g_joint, colour);
                per_b_alone = dot(g_background, colour);
                if let Some(marks) = marks {
                    let mark = marks.background[row];
                    per_b += g_marks[0] * mark[0] + g_marks[1] * mark[1];
                }
            }
            if let Some(row) = step.object_row {
                // Loss per unit of a_F within this interval.
                let here = step.joint * (per_f * (1.0 - 0.5 * a_b) - 0.5 * per_b * a_b)
                    + step.object_alone * per_f_alone;
                let behind = behind_joint + behind_object;
                let opacity = &step.object;
                let g_l = behind + g_log - opacity.survival * here;
                let at = (row - part.object_start) * self.object_width;
                let out = &mut part.object[at..at + object_column::COUNT];
                let values = &self.object[row * self.object_width..];
                let chain = kernels[0].backward(
                    values[object_column::SDF],
                    values[object_column::SLOPE],
                    dt,
                    g_l * opacity.log_slope(),
                );
                out[object_column::SDF] = chain.sdf;
                out[object_column::SLOPE] = chain.slope;
                sharpness[0] += f64::from(chain.sharpness);
                let alone = step.object_alone * a_f;
                let weight = step.object_weight();
                let head = self.head(row);
                for c in 0..3 {
                    out[object_column::COLOUR + c] =
                        head * (weight * g_joint[c] + alone * g_object[c]);
                }
                out[object_column::MATTE] = match self.config.matte {
                    MatteRole::Unused => 0.0,
                    MatteRole::Colour => weight * per_head + alone * per_head_alone,
                    // What lies behind is proportional to the survival, so its quotient is bounded.
                    MatteRole::Opacity => {
                        opacity.bare_alpha
                            * (here
                                - behind / opacity.survival.max(f32::MIN_POSITIVE)
                                - g_log / opacity.survival.max(LEAST_SURVIVAL))
                    }
                };
            }
            if let Some(row) = step.background_row {
                let here = step.joint * (per_b * (1.0 - 0.5 * a_f) - 0.5 * per_f * a_f)
                    + step.background_alone * per_b_alone;
                let g_l = behind_joint + behind_background - step.background.survival * here;
                let at = (row - part.background_start) * self.background_width;
                let out = &mut part.background[at..at + background_column::COUNT];
                let values = &self.background[row * self.background_width..];
                let chain = kernels[1].backward(
                    values[background_column::SDF],
                    values[background_column::SLOPE],
                    dt,
                    g_l,
                );
                out[background_column::SDF] = chain.sdf;
                out[background_column::SLOPE] = chain.slope;
                sharpness[1] += f64::from(chain.sharpness);
                let alone = step.background_alone * a_b;
                let weight = step.background_weight();
                for c in 0..3 {
                    out[background_column::COLOUR + c] =
                        weight * g_joint[c] + alone * g_background[c];
                }
            }
            behind_joint += per_f * step.object_weight() + per_b * step.background_weight();
            behind_object += per_f_alone * step.object_alone * a_f;
            behind_background += per_b_alone * step.background_alone * a_b;
        }
        sharpness
    }
}

#[inline]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
