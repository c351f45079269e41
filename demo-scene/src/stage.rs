//! The whole composition and what a ray meets in it.
//!
//! The stage frame has its origin in the middle of the table top; [`TABLE_CENTRE`] is that point
//! in world coordinates and both frames share their axes.

use glam::DVec3;

use crate::arrangement;
use crate::clutter::Clutter;
use crate::kind::SceneKind;
use crate::paint::Material;
use crate::prop::{Prop, Thing};
use crate::room::{ROOM_HIGH, ROOM_LOW, plain_shell_material, shell_material};
use crate::subject::Subject;

/// World coordinates (metres, z up) of the middle of the table top: the scene is deliberately
/// not centred at the origin.
pub const TABLE_CENTRE: DVec3 = DVec3::new(1.3, -0.7, 0.75);

/// Which things a ray may meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Seen {
    Everything,
    /// The target is invisible.
    Background,
}

/// Where a ray first meets the scene.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    /// Distance along the ray, metres.
    pub(crate) t: f64,
    pub(crate) point: DVec3,
    pub(crate) normal: DVec3,
    /// Index into the props, or `None` for the room's shell.
    pub(crate) prop: Option<usize>,
}

/// Everything there is to see.
#[derive(Clone, Debug)]
pub(crate) struct Stage {
    pub(crate) props: Vec<Prop>,
    kind: SceneKind,
}

/// The target comes first.
pub(crate) const TARGET: usize = 0;

impl Stage {
    pub(crate) fn new(kind: SceneKind) -> Self {
        let mut props = vec![Prop::new(
            Thing::Target(Subject::of(kind)),
            arrangement::TARGET_PLACE.0,
            arrangement::TARGET_PLACE.1,
            Subject::BOUNDS,
        )];
        for (piece, middle, degrees, half) in arrangement::furniture(kind) {
            props.push(Prop::new(
                Thing::Furniture(piece),
                middle,
                degrees,
                (half, DVec3::ZERO),
            ));
        }
        for (clutter, foot, degrees) in arrangement::clutter(kind) {
            let thing = Thing::Clutter(clutter);
            props.push(Prop::new(thing, foot, degrees, clutter.bounds()));
        }
        Self { props, kind }
    }

    /// A point of the axis that the turntable turns about.
    pub(crate) fn axis(&self) -> DVec3 {
        arrangement::TARGET_PLACE.0
    }

    /// The same with the target and the turntable turned by `turn` radians.
    pub(crate) fn turned(&self, turn: f64) -> Self {
        let mut stage = self.clone();
        if turn == 0.0 {
            // Turning by nothing would still round.
            return stage;
        }
        for prop in &mut stage.props {
            if let Thing::Target(_) | Thing::Clutter(Clutter::Turntable { .. }) = prop.thing {
                *prop = prop.turned(self.axis(), turn);
            }
        }
        stage
    }

    pub(crate) fn target(&self) -> &Prop {
        &self.props[TARGET]
    }

    /// First surface along a ray; there always is one, since the room is closed.
    pub(crate) fn trace(&self, from: DVec3, along: DVec3, seen: Seen) -> Hit {
        let (mut t, normal) = leave_room(from, along);
        let (mut best, mut best_normal) = (None, Some(normal));
        for (index, prop) in self.props.iter().enumerate() {
            if seen == Seen::Background && index == TARGET {
                continue;
            }
            if let Some((distance, normal)) = prop.meet(from, along, t) {
                (t, best, best_normal) = (distance, Some(index), normal);
            }
        }
        let point = from + along * t;
        let normal = match (best_normal, best) {
            (Some(normal), _) => normal,
            (None, Some(index)) => self.props[index].normal(point),
            (None, None) => normal,
        };
        Hit {
            t,
            point,
            normal,
            prop: best,
        }
    }

    pub(crate) fn material(&self, hit: &Hit) -> Material {
        match hit.prop {
            Some(index) => self.props[index].material(hit.point, hit.normal),
            None if self.kind == SceneKind::Plain => plain_shell_material(hit.normal),
            None => shell_material(hit.point, hit.normal),
        }
    }

    /// Signed distance to whatever the hit belongs to.
    pub(crate) fn distance(&self, prop: Option<usize>, p: DVec3) -> f64 {
        match prop {
            Some(index) => self.props[index].sdf(p),
            None => (p - ROOM_LOW).min(ROOM_HIGH - p).min_element(),
        }
    }
}

fn leave_room(from: DVec3, along: DVec3) -> (f64, DVec3) {
    let inverse = along.recip();
    let far = ((ROOM_LOW - from) * inverse).max((ROOM_HIGH - from) * inverse);
    let t = far.min_element();
    let axis = if far.x <= far.y.min(far.z) {
        DVec3::X
    } else if far.y <= far.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    (t, -along.signum() * axis)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every thing on the table stands apart from the target.
    #[test]
    fn nothing_runs_into_the_target() {
        let stage = Stage::new(SceneKind::Can);
        let target = stage.target();
        let (half, centre) = Subject::BOUNDS;
        let steps = |half: f64| (0..=40).map(move |i| half * (f64::from(i) / 20.0 - 1.0));
        for (index, prop) in stage.props.iter().enumerate().skip(1) {
            for x in steps(half.x) {
                for y in steps(half.y) {
                    for z in steps(half.z) {
                        let p = target.place(centre + DVec3::new(x, y, z));
                        let clear = target.sdf(p) > 0.0 || prop.sdf(p) > -1e-9;
                        assert!(clear, "prop {index} meets the target at {p}");
                    }
                }
            }
        }
    }

    #[test]
    fn rays_stop_on_surfaces() {
        let stage = Stage::new(SceneKind::Can);
        let eye = DVec3::new(0.5, -0.4, 0.4);
        for i in 0..400 {
            let aim = DVec3::new(
                f64::from(i % 20) * 0.05 - 0.5,
                f64::from(i / 20) * 0.05 - 0.5,
                0.03,
            );
            let along = (aim - eye).normalize();
            let hit = stage.trace(eye, along, Seen::Everything);
            assert!(stage.distance(hit.prop, hit.point).abs() < 2e-4, "{aim}");
            assert!(hit.normal.dot(along) < 0.2, "{aim} {:?}", hit);
        }
    }
}
