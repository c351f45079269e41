//! Pictures of a scene whose one field says by a share what is the object.
//!
//! The matte is the blend of shares that was trained ([`train::semantic`](crate::train::semantic)). For
//! everything else a place is the object's or not: samples with a share above a half are drawn as FoCoR's
//! would be, the others as BaCo's. So such a run has cut-outs, plates, depths and a mesh as well, and is
//! scored as any other.

use neus_render::composite::{Packing, background_column, object_column, sample_visibility};
use neus_render::rays::Ray;
use rayon::prelude::*;

use super::rays::{CHUNK, Extent, FrozenScene, RenderedRay, opaque_by};
use crate::train::batch::{BatchMarcher, MarchedBatch};
use crate::train::semantic::share_at;
use crate::train::visible::{Alone, Look, composite_config};

/// Above this share a place is the object's.
const HALF: f32 = 0.5;

impl FrozenScene {
    /// The blend of shares along each ray, over all of its samples.
    pub(super) fn semantic_mattes(&self, rays: &[Ray]) -> Vec<f32> {
        rays.par_chunks(CHUNK)
            .map_init(BatchMarcher::default, |marcher, chunk| {
                let marched = self.march(chunk, marcher, Extent::All);
                let (marched, look) = self
                    .fields
                    .look(marched, &self.config, 1.0, |_| Alone::default());
                shares(&marched, &look, chunk.len())
            })
            .flatten_iter()
            .collect()
    }

    /// `marched`, all of whose samples are the one field's, as if there were two.
    ///
    /// All samples are asked: what lies behind the object, where no light gets to, is what plates show.
    pub(super) fn split(&self, marched: &MarchedBatch, extent: Extent) -> (MarchedBatch, Look) {
        let geometry = self.fields.background.geometry(&marched.background.points);
        let of = |object: bool| -> Vec<u32> {
            (0..marched.background.len())
                .filter(|&i| (share_at(&geometry, i) > HALF) == object)
                .map(|i| i as u32)
                .collect()
        };
        let object = of(true);
        let background = match extent {
            Extent::All | Extent::Box | Extent::BeforeObject => of(false),
            Extent::Object => Vec::new(),
        };
        let all = &marched.packing;
        let intervals = |rows: &[u32]| -> Vec<u32> {
            rows.iter().map(|&i| all.background()[i as usize]).collect()
        };
        let split = MarchedBatch {
            packing: Packing::new(
                all.ray_offsets().to_vec(),
                all.t().to_vec(),
                all.dt().to_vec(),
                intervals(&object),
                intervals(&background),
            ),
            object: marched.background.select(&object),
            background: marched.background.select(&background),
        };
        let [object, background] = [object, background].map(|rows| geometry.select(&rows));
        let transparency = self.config.model.background;
        let rows = |of: &scene_decomp::Geometry, columns: usize| -> Vec<f32> {
            let samples = of.values.len() / of.columns;
            let mut rows = vec![0.0; columns * samples];
            for (i, row) in rows.chunks_exact_mut(columns).enumerate() {
                row[background_column::SDF] = opaque_by(transparency, of.sdf(i));
                // Matte values, where a row has one.
                row[background_column::COUNT..].fill(1.0);
            }
            rows
        };
        let visibility = sample_visibility(
            &rows(&object, object_column::COUNT),
            &rows(&background, background_column::COUNT),
            self.fields.sharpness,
            &split.packing,
            composite_config(&self.config, 1.0),
        );
        let look = Look {
            object,
            background,
            visibility,
            through_object: false,
        };
        (split, look)
    }
}

/// `rendered` with the blend of shares for its mattes.
pub(super) fn with_shares(
    rendered: Vec<RenderedRay>,
    marched: &MarchedBatch,
    look: &Look,
) -> Vec<RenderedRay> {
    let mattes = shares(marched, look, rendered.len());
    rendered
        .into_iter()
        .zip(mattes)
        .map(|(ray, matte)| RenderedRay { matte, ..ray })
        .collect()
}

/// The blend of shares of each ray's samples, whichever side they are on; those that light does not
/// reach count nothing.
fn shares(marched: &MarchedBatch, look: &Look, rays: usize) -> Vec<f32> {
    let mut mattes = vec![0.0f32; rays];
    for (samples, geometry, visibility) in [
        (&marched.object, &look.object, &look.visibility.object),
        (
            &marched.background,
            &look.background,
            &look.visibility.background,
        ),
    ] {
        for (i, (&ray, seen)) in samples.ray.iter().zip(visibility).enumerate() {
            if seen.weight > 0.0 {
                mattes[ray as usize] += seen.weight * share_at(geometry, i);
            }
        }
    }
    mattes.into_iter().map(|m| m.clamp(0.0, 1.0)).collect()
}
