//! How far the masks can be relied on, measured by the surface that all of them agreed on.
//!
//! Rough masks are wrong in different places in different views: FoCoR, carved out of the scene by
//! what most views say, contradicts them, and must not be pulled back. Good masks differ from it by
//! a pixel or two, and know better than colours do where white fur ends before a white wall. So a
//! mask's say late in training follows from its overlap with FoCoR's matte.

/// Overlap below which masks are not believed in detail, and from which they are believed fully.
const DOUBTED: f32 = 0.88;
const BELIEVED: f32 = 0.95;
/// What older rays count after each update.
const KEPT: f32 = 0.7;

/// The share of the masks' and the mattes' union that is in both, view by view.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// Per view: intersection, union, in rays.
    sums: Vec<[f32; 2]>,
    trust: Vec<f32>,
}

impl Agreement {
    /// Nothing known: no view is trusted.
    #[must_use]
    pub fn new(views: usize) -> Self {
        Self {
            sums: vec![[0.0; 2]; views],
            trust: vec![0.0; views],
        }
    }

    /// Number of views.
    #[must_use]
    pub fn views(&self) -> usize {
        self.trust.len()
    }

    /// A ray of `view` whose own mask says `object` and whose matte is `matte`.
    pub fn add(&mut self, view: usize, matte: f32, object: bool) {
        let mask = f32::from(u8::from(object));
        self.sums[view][0] += matte.min(mask);
        self.sums[view][1] += matte.max(mask);
    }

    /// Draws conclusions from the rays so far, and has them count less from now on.
    pub fn update(&mut self) {
        let overlaps: Vec<Option<f32>> = self
            .sums
            .iter()
            .map(|[both, either]| (*either > 0.0).then(|| both / either))
            .collect();
        self.trust = trust(&overlaps);
        for sum in self.sums.iter_mut().flatten() {
            *sum *= KEPT;
        }
    }

    /// Trust in the mask of `view`, 0 to 1.
    #[must_use]
    pub fn trust(&self, view: usize) -> f32 {
        self.trust[view]
    }

    /// Everything as one list, for a checkpoint: three numbers a view.
    #[must_use]
    pub fn values(&self) -> Vec<f32> {
        let views = self.sums.iter().zip(&self.trust);
        views.flat_map(|([a, b], c)| [*a, *b, *c]).collect()
    }

    /// Takes over what [`values`](Self::values) gave; `None` when it is of another number of views.
    #[must_use]
    pub fn from_values(views: usize, values: &[f32]) -> Option<Self> {
        (values.len() == 3 * views).then(|| Self {
            sums: values.chunks_exact(3).map(|v| [v[0], v[1]]).collect(),
            trust: values.chunks_exact(3).map(|v| v[2]).collect(),
        })
    }
}

/// Trust in each view's mask by its overlap with the matte; `None` without a mask.
///
/// A view is trusted as far as it agrees, but no more than the median view: among masks that are
/// rough on the whole, one that happens to agree better is not more precise.
#[must_use]
pub fn trust(overlaps: &[Option<f32>]) -> Vec<f32> {
    let mut known: Vec<f32> = overlaps.iter().flatten().copied().collect();
    known.sort_by(f32::total_cmp);
    let median = known.get(known.len() / 2).copied().unwrap_or(0.0);
    overlaps
        .iter()
        .map(|overlap| {
            overlap.map_or(0.0, |overlap| {
                ((overlap.min(median) - DOUBTED) / (BELIEVED - DOUBTED)).clamp(0.0, 1.0)
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precise_masks_are_trusted_and_the_wrong_one_among_them_is_not() {
        let mut agreement = Agreement::new(4);
        for view in 0..3 {
            for i in 0..100 {
                let object = i < 50 || (view == 1 && i < 80);
                agreement.add(view, f32::from(u8::from(i < 50)), object);
            }
        }
        assert_eq!(agreement.trust(0), 0.0);
        agreement.update();
        let trust: Vec<f32> = (0..4).map(|view| agreement.trust(view)).collect();
        assert_eq!(trust, [1.0, 0.0, 1.0, 0.0]);
        let back = Agreement::from_values(4, &agreement.values());
        assert_eq!(back, Some(agreement));
        assert_eq!(Agreement::from_values(3, &[0.0; 12]), None);
    }

    #[test]
    fn a_good_mask_among_rough_ones_is_not_trusted() {
        let found = trust(&[Some(0.8), Some(0.97), Some(0.75), Some(0.82), None]);
        assert_eq!(found, [0.0; 5]);
    }
}
