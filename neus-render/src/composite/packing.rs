//! Which sample of which field belongs to which interval of which ray.

use crate::march::Intervals;

/// The constant side of a batch: intervals packed by ray, and for each field the intervals that
/// have a sample, in order. Rows of a field's tensor are numbered by that order.
///
/// ```
/// use neus_render::composite::Packing;
///
/// // One ray with two intervals; the object has a sample in both, the background in the second.
/// let packing = Packing::new(vec![0, 2], vec![1.0, 2.0], vec![1.0, 1.0], vec![0, 1], vec![1]);
/// assert_eq!(packing.ray_count(), 1);
/// assert_eq!(packing.background_offsets(), [0, 1]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Packing {
    ray_offsets: Vec<u32>,
    t: Vec<f32>,
    dt: Vec<f32>,
    object: Vec<u32>,
    background: Vec<u32>,
    object_offsets: Vec<u32>,
    background_offsets: Vec<u32>,
    marks: Option<Marks>,
    /// What a device has of it, so that nothing is sent there a second time for gradients.
    #[cfg(feature = "cube")]
    pub(super) on_device: super::cube::OnDevice,
}

/// Two constants of every sample, which compositing blends as it does colours: see
/// [`column::MARKS`](super::column::MARKS).
///
/// Their blend's gradient reaches opacities alone. A loss whose derivative by a sample's weight is
/// known beforehand becomes a pixel that way.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Marks {
    /// Of the object's rows, `[m_f]`.
    pub object: Vec<[f32; 2]>,
    /// Of the background's rows, `[m_b]`.
    pub background: Vec<[f32; 2]>,
}

/// Of no rays.
impl Default for Packing {
    fn default() -> Self {
        Self::new(vec![0], Vec::new(), Vec::new(), Vec::new(), Vec::new())
    }
}

impl Packing {
    /// A packing from its lists: `ray_offsets` `[rays + 1]`, midpoints `t` and lengths `dt` `[n]`, and
    /// for each field the intervals that its rows belong to, strictly ascending, `[m_f]` and `[m_b]`.
    ///
    /// # Panics
    /// When offsets don't ascend from 0 to n, lengths differ, or indices don't ascend within 0..n.
    pub fn new(
        ray_offsets: Vec<u32>,
        t: Vec<f32>,
        dt: Vec<f32>,
        object: Vec<u32>,
        background: Vec<u32>,
    ) -> Self {
        let n = t.len();
        assert_eq!(
            n,
            dt.len(),
            "Packing::new: {n} midpoints but {} lengths",
            dt.len()
        );
        assert!(
            ray_offsets.first() == Some(&0)
                && ray_offsets.last() == Some(&(n as u32))
                && ray_offsets.is_sorted(),
            "Packing::new: ray_offsets must ascend from 0 to the number of intervals, {n}"
        );
        for (name, index) in [("object", &object), ("background", &background)] {
            assert!(
                index.is_sorted_by(|a, b| a < b) && index.last().is_none_or(|&i| (i as usize) < n),
                "Packing::new: intervals of the {name} must strictly ascend within 0..{n}"
            );
        }
        let object_offsets = sample_offsets(&ray_offsets, &object);
        let background_offsets = sample_offsets(&ray_offsets, &background);
        Self {
            ray_offsets,
            t,
            dt,
            object,
            background,
            object_offsets,
            background_offsets,
            marks: None,
            #[cfg(feature = "cube")]
            on_device: super::cube::OnDevice::default(),
        }
    }

    /// The same with marks of all samples.
    ///
    /// # Panics
    /// When there is not one mark for each sample.
    #[must_use]
    pub fn with_marks(mut self, marks: Marks) -> Self {
        assert!(
            marks.object.len() == self.object.len()
                && marks.background.len() == self.background.len(),
            "Packing::with_marks: {} and {} marks for {} and {} samples",
            marks.object.len(),
            marks.background.len(),
            self.object.len(),
            self.background.len()
        );
        self.marks = Some(marks);
        #[cfg(feature = "cube")]
        {
            self.on_device = super::cube::OnDevice::default();
        }
        self
    }

    /// The samples' marks, where they have some.
    pub fn marks(&self) -> Option<&Marks> {
        self.marks.as_ref()
    }

    /// The packing of marched intervals: each field has a sample where its flag is set.
    pub fn from_intervals(intervals: &Intervals) -> Self {
        let set = |flags: &[bool]| -> Vec<u32> {
            let numbers = 0..flags.len() as u32;
            numbers.filter(|&i| flags[i as usize]).collect()
        };
        let ray_offsets = if intervals.ray_offsets.is_empty() {
            vec![0]
        } else {
            intervals.ray_offsets.clone()
        };
        Self::new(
            ray_offsets,
            intervals.t.clone(),
            intervals.dt.clone(),
            set(&intervals.object),
            set(&intervals.background),
        )
    }

    /// How many rays there are.
    pub fn ray_count(&self) -> usize {
        self.ray_offsets.len() - 1
    }

    /// How many intervals there are.
    pub fn interval_count(&self) -> usize {
        self.t.len()
    }

    /// Ray `i` has the intervals `ray_offsets[i]..ray_offsets[i + 1]`; `[rays + 1]`.
    pub fn ray_offsets(&self) -> &[u32] {
        &self.ray_offsets
    }

    /// Midpoints of the intervals; `[n]`.
    pub fn t(&self) -> &[f32] {
        &self.t
    }

    /// Lengths of the intervals; `[n]`.
    pub fn dt(&self) -> &[f32] {
        &self.dt
    }

    /// The interval of each row of the object's tensor; `[m_f]`.
    pub fn object(&self) -> &[u32] {
        &self.object
    }

    /// The interval of each row of the background's tensor; `[m_b]`.
    pub fn background(&self) -> &[u32] {
        &self.background
    }

    /// Ray `i` has the object's rows `object_offsets[i]..object_offsets[i + 1]`; `[rays + 1]`.
    pub fn object_offsets(&self) -> &[u32] {
        &self.object_offsets
    }

    /// As [`object_offsets`](Self::object_offsets), for the background; `[rays + 1]`.
    pub fn background_offsets(&self) -> &[u32] {
        &self.background_offsets
    }
}

/// Where each ray's rows begin among the ascending interval numbers of a field.
fn sample_offsets(ray_offsets: &[u32], index: &[u32]) -> Vec<u32> {
    let mut row = 0;
    ray_offsets
        .iter()
        .map(|&end| {
            while row < index.len() && index[row] < end {
                row += 1;
            }
            row as u32
        })
        .collect()
}
