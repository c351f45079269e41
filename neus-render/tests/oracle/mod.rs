//! The textbook formulas in f64, as NeuS and volume rendering write them, one line each and with
//! no care for numerics: what the shipped single-precision forms are compared with.

use neus_render::{
    composite::{CompositeConfig, Marks, MatteRole, Packing, Transparency, column},
    random::unit_float,
};

/// A batch in f64: rows as in `composite`.
#[derive(Clone)]
pub(crate) struct Scene {
    pub(crate) object: Vec<[f64; 6]>,
    pub(crate) background: Vec<[f64; 5]>,
    pub(crate) sharpness: [f64; 2],
    pub(crate) packing: Packing,
    pub(crate) config: CompositeConfig,
}

pub(crate) fn phi(s: f64, x: f64) -> f64 {
    1.0 / (1.0 + (-s * x).exp())
}

/// NeuS's opacity as its code has it.
pub(crate) fn neus_alpha(sdf: f64, slope: f64, dt: f64, s: f64, anneal: f64, epsilon: f64) -> f64 {
    let relu = |x: f64| x.max(0.0);
    let cos = -(relu(-slope * 0.5 + 0.5) * (1.0 - anneal) + relu(-slope) * anneal);
    let previous = phi(s, sdf - cos * dt / 2.0);
    let next = phi(s, sdf + cos * dt / 2.0);
    ((previous - next + epsilon) / (previous + epsilon)).clamp(0.0, 1.0)
}

impl Scene {
    fn alpha(&self, kind: Transparency, sdf: f64, slope: f64, dt: f64, s: f64) -> f64 {
        let (anneal, epsilon) = (
            f64::from(self.config.cos_anneal),
            f64::from(self.config.epsilon),
        );
        match kind {
            Transparency::Sdf => neus_alpha(sdf, slope, dt, s, anneal, epsilon),
            Transparency::Density => 1.0 - (-sdf.max(0.0) * dt).exp(),
        }
    }

    /// Pixels, [rays, 20].
    pub(crate) fn pixels(&self) -> Vec<[f64; column::COUNT]> {
        let packing = &self.packing;
        let mut out = Vec::new();
        for range in packing.ray_offsets().windows(2) {
            let mut pixel = [0.0; column::COUNT];
            let (mut joint, mut only_f, mut only_b) = (1.0, 1.0, 1.0);
            for i in range[0]..range[1] {
                let t = f64::from(packing.t()[i as usize]);
                let dt = f64::from(packing.dt()[i as usize]);
                let f = packing.object().iter().position(|&x| x == i);
                let b = packing.background().iter().position(|&x| x == i);
                let mark = |of: Option<[f32; 2]>| of.unwrap_or_default().map(f64::from);
                let marks = packing.marks();
                let mark_f = mark(marks.and_then(|marks| Some(marks.object[f?])));
                let mark_b = mark(marks.and_then(|marks| Some(marks.background[b?])));
                let f = f.map_or([0.0; 6], |row| self.object[row]);
                let (matte, head) = match self.config.matte {
                    MatteRole::Unused => (1.0, 1.0),
                    MatteRole::Opacity => (f[5], 1.0),
                    MatteRole::Colour => (1.0, f[5]),
                };
                let a_f = if packing.object().contains(&i) {
                    matte * self.alpha(self.config.object, f[0], f[1], dt, self.sharpness[0])
                } else {
                    0.0
                };
                let a_b = if packing.background().contains(&i) {
                    let b = b.map_or([0.0; 5], |row| self.background[row]);
                    self.alpha(self.config.background, b[0], b[1], dt, self.sharpness[1])
                } else {
                    0.0
                };
                let b = b.map_or([0.0; 5], |row| self.background[row]);
                let w_f = joint * a_f * (1.0 - a_b / 2.0);
                let w_b = joint * a_b * (1.0 - a_f / 2.0);
                for c in 0..3 {
                    pixel[column::JOINT_COLOUR + c] += w_f * head * f[2 + c] + w_b * b[2 + c];
                    pixel[column::OBJECT_COLOUR + c] += only_f * a_f * head * f[2 + c];
                    pixel[column::BACKGROUND_COLOUR + c] += only_b * a_b * b[2 + c];
                }
                for c in 0..2 {
                    pixel[column::MARKS + c] += w_f * mark_f[c] + w_b * mark_b[c];
                }
                if self.config.matte == MatteRole::Colour {
                    pixel[column::HEAD] += w_f * head;
                    pixel[column::HEAD_ALONE] += only_f * a_f * head;
                }
                pixel[column::MATTE] += w_f;
                pixel[column::JOINT_DEPTH] += (w_f + w_b) * t;
                pixel[column::OBJECT_DEPTH] += only_f * a_f * t;
                pixel[column::OBJECT_LOG_TRANSMITTANCE] += (1.0 - a_f).ln();
                joint *= (1.0 - a_f) * (1.0 - a_b);
                only_f *= 1.0 - a_f;
                only_b *= 1.0 - a_b;
            }
            pixel[column::OBJECT_OPACITY] = 1.0 - only_f;
            pixel[column::BACKGROUND_OPACITY] = 1.0 - only_b;
            pixel[column::JOINT_OPACITY] = 1.0 - joint;
            out.push(pixel);
        }
        out
    }

    /// `sum probe * pixels`, a loss whose gradient with respect to the pixels is `probe`.
    pub(crate) fn loss(&self, probe: &[f32]) -> f64 {
        let pixels = self.pixels();
        let values = pixels.iter().flatten();
        values.zip(probe).map(|(v, &p)| v * f64::from(p)).sum()
    }

    pub(crate) fn object_f32(&self) -> Vec<f32> {
        self.object.iter().flatten().map(|&v| v as f32).collect()
    }

    pub(crate) fn background_f32(&self) -> Vec<f32> {
        let values = self.background.iter().flatten();
        values.map(|&v| v as f32).collect()
    }
}

/// A random batch with every kind of ray: intervals with both fields, one, none; empty rays.
///
/// Signed distances stay within a few widths of the surface, slopes away from the kinks of the
/// annealed slope at 0 and 1, and matte values below one, so that finite differences see a smooth
/// function.
pub(crate) fn random_scene(
    rays: usize,
    longest: usize,
    config: CompositeConfig,
    seed: u64,
) -> Scene {
    let mut counter = 0;
    let mut random = || {
        counter += 1;
        // Rounded to f32, so that both precisions see the same numbers.
        f64::from(unit_float(seed, counter))
    };
    let mut offsets = vec![0];
    let (mut t, mut dt) = (Vec::new(), Vec::new());
    let (mut index_f, mut index_b) = (Vec::new(), Vec::new());
    let (mut object, mut background) = (Vec::new(), Vec::new());
    for ray in 0..rays {
        let count = if ray % 5 == 3 {
            0
        } else {
            (random() * (longest + 1) as f64) as usize
        };
        let mut at = 1.0;
        for _ in 0..count {
            let length = (0.02 + 0.1 * random()) as f32;
            t.push(at + 0.5 * length);
            dt.push(length);
            at += length;
            let interval = t.len() as u32 - 1;
            let mut slope = || {
                let x = random() * 1.8 - 0.9;
                let away = x + 0.05f64.copysign(x);
                f64::from(away as f32)
            };
            let (slope_f, slope_b) = (slope(), slope());
            let which = random();
            let sample = |kind: Transparency, x: f64| match kind {
                Transparency::Sdf => f64::from((0.4 * x - 0.15) as f32),
                Transparency::Density => f64::from((0.05 + 8.0 * x) as f32),
            };
            if which < 0.7 {
                index_f.push(interval);
                let sdf = sample(config.object, random());
                let matte = f64::from((0.05 + 0.9 * random()) as f32);
                object.push([sdf, slope_f, random(), random(), random(), matte]);
            }
            if which > 0.35 && which < 0.95 {
                index_b.push(interval);
                let sdf = sample(config.background, random());
                background.push([sdf, slope_b, random(), random(), random()]);
            }
        }
        offsets.push(t.len() as u32);
    }
    let mut marks = |count: usize| {
        let mark = |_| [random() as f32 - 0.3, random() as f32];
        (0..count).map(mark).collect::<Vec<_>>()
    };
    let marks = Marks {
        object: marks(object.len()),
        background: marks(background.len()),
    };
    Scene {
        object,
        background,
        sharpness: [12.0, 7.0],
        packing: Packing::new(offsets, t, dt, index_f, index_b).with_marks(marks),
        config,
    }
}
