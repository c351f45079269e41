//! Packed intervals of a batch of rays, and the samples that fields have in them.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::rays::Ray;

/// One of the two fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Field {
    /// The object, only inside its box.
    Object,
    /// The scene without it, everywhere.
    Background,
}

/// Packed intervals of a batch of rays; see [`march`](crate::march).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Intervals {
    /// Ray `i` has the intervals `ray_offsets[i]..ray_offsets[i + 1]`; `[rays + 1]`.
    pub ray_offsets: Vec<u32>,
    /// Midpoints, ascending within a ray; `[n]`.
    pub t: Vec<f32>,
    /// Lengths; `[n]`.
    pub dt: Vec<f32>,
    /// Whether the object is to be evaluated; `[n]`.
    pub object: Vec<bool>,
    /// Whether the background is to be evaluated; `[n]`.
    pub background: Vec<bool>,
}

impl Intervals {
    /// Empties the lists and keeps their memory.
    pub fn clear(&mut self) {
        self.ray_offsets.clear();
        self.t.clear();
        self.dt.clear();
        self.object.clear();
        self.background.clear();
    }

    /// How many intervals there are.
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// How many rays there are.
    pub fn ray_count(&self) -> usize {
        self.ray_offsets.len().saturating_sub(1)
    }

    /// The flags of a field; `[n]`.
    pub fn flags(&self, field: Field) -> &[bool] {
        match field {
            Field::Object => &self.object,
            Field::Background => &self.background,
        }
    }

    /// Writes where `field` is to be evaluated into `out`, in the order of the intervals.
    ///
    /// # Panics
    /// When these intervals don't belong to a batch of as many rays.
    pub fn samples_into(&self, field: Field, rays: &[Ray], out: &mut Samples) {
        assert_eq!(
            self.ray_count(),
            rays.len(),
            "Intervals::samples_into: intervals of {} rays, but {} rays",
            self.ray_count(),
            rays.len()
        );
        out.clear();
        let flags = self.flags(field);
        for (number, (ray, range)) in rays.iter().zip(self.ray_offsets.windows(2)).enumerate() {
            for interval in range[0]..range[1] {
                if flags[interval as usize] {
                    out.interval.push(interval);
                    out.ray.push(number as u32);
                    out.points.push(ray.at(self.t[interval as usize]));
                }
            }
        }
    }

    /// [`samples_into`](Self::samples_into) with fresh lists.
    pub fn samples(&self, field: Field, rays: &[Ray]) -> Samples {
        let mut out = Samples::default();
        self.samples_into(field, rays, &mut out);
        out
    }
}

/// Where one field is to be evaluated: `m` samples in the order of the intervals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Samples {
    /// The interval each belongs to, strictly ascending; `[m]`.
    pub interval: Vec<u32>,
    /// The ray each belongs to; `[m]`.
    pub ray: Vec<u32>,
    /// The midpoints in the space of the rays, not contracted; `[m]`.
    pub points: Vec<Vec3>,
}

impl Samples {
    /// Empties the lists and keeps their memory.
    pub fn clear(&mut self) {
        self.interval.clear();
        self.ray.clear();
        self.points.clear();
    }

    /// How many samples there are.
    pub fn len(&self) -> usize {
        self.interval.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.interval.is_empty()
    }
}
