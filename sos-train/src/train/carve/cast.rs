//! What all masks say about the surfaces that their pixels show, asked at once.

use scene_decomp::SurfaceVotes;

use super::depth::{DepthPicture, depth_pictures};
use super::{RAYS, rays_of};
use crate::prepare::Prepared;
use crate::render::rays::FrozenScene;
use crate::train::Trainer;

impl Trainer {
    /// Forgets the votes so far and has all masks vote on the surfaces of `scene`, as the masks are now.
    pub(super) fn vote_anew(&mut self, scene: &FrozenScene, data: &Prepared) {
        let depths = depth_pictures(scene, data, rays_of(data, RAYS));
        self.votes = cast(data, &depths, self.map.resolution());
    }
}

fn cast(data: &Prepared, depths: &[DepthPicture], resolution: usize) -> SurfaceVotes {
    let mut votes = SurfaceVotes::new(resolution);
    for ((view, depth), outline) in data.views.iter().zip(depths).zip(&data.outlines) {
        let world_from_camera = view.world_from_camera(&data.frame);
        for (i, &distance) in depth.distances.iter().enumerate() {
            if !distance.is_finite() {
                continue;
            }
            let pixel = depth.pixel(i);
            let (x, y) = (pixel.x as u32, pixel.y as u32);
            if x >= view.width() || y >= view.height() {
                continue;
            }
            if let (Some(vote), Some(ray)) =
                (outline.vote(x, y), view.ray(&world_from_camera, pixel))
            {
                votes.add(
                    ray.origin + distance * ray.direction,
                    vote.weight,
                    vote.object,
                );
            }
        }
    }
    votes
}
