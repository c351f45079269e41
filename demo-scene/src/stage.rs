//! The composition: which things stand where, and what a ray meets.
//!
//! The stage frame has its origin in the middle of the table top; [`TABLE_CENTRE`] is that point
//! in world coordinates and both frames share their axes.

use glam::{DVec2, DVec3};

use crate::clutter::Clutter;
use crate::paint::Material;
use crate::room::{Furniture, ROOM_HIGH, ROOM_LOW, shell_material};
use crate::watering_can;

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

/// What stands on the stage.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Thing {
    Target,
    Clutter(Clutter),
    Furniture(Furniture),
}

/// A thing at its place: turned about z, then moved.
#[derive(Clone, Debug)]
pub(crate) struct Prop {
    pub(crate) thing: Thing,
    origin: DVec3,
    /// Cosine and sine of the turn.
    turn: DVec2,
    /// Bounding box in the thing's own frame.
    half: DVec3,
    middle: DVec3,
    /// Bounding sphere in the stage frame.
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
}

impl Prop {
    fn new(thing: Thing, origin: DVec3, degrees: f64, bounds: (DVec3, DVec3)) -> Self {
        let angle = degrees.to_radians();
        let turn = DVec2::new(libm::cos(angle), libm::sin(angle));
        let (half, middle) = bounds;
        let mut prop = Self { thing, origin, turn, half, middle, centre: origin, radius: half.length() };
        prop.centre = origin + prop.outward(middle);
        prop
    }

    fn inward(&self, v: DVec3) -> DVec3 {
        let (c, s) = (self.turn.x, self.turn.y);
        DVec3::new(c * v.x + s * v.y, c * v.y - s * v.x, v.z)
    }

    fn outward(&self, v: DVec3) -> DVec3 {
        let (c, s) = (self.turn.x, self.turn.y);
        DVec3::new(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
    }

    /// Stage point to the thing's own frame.
    pub(crate) fn local(&self, p: DVec3) -> DVec3 {
        self.inward(p - self.origin)
    }

    /// The thing's own frame to the stage.
    pub(crate) fn place(&self, p: DVec3) -> DVec3 {
        self.outward(p) + self.origin
    }

    fn local_sdf(&self, p: DVec3) -> f64 {
        match &self.thing {
            Thing::Target => watering_can::sdf(p),
            Thing::Clutter(clutter) => clutter.sdf(p),
            Thing::Furniture(_) => crate::primitives::rounded_box(p - self.middle, self.half, 0.0),
        }
    }

    /// Signed distance of a stage point.
    pub(crate) fn sdf(&self, p: DVec3) -> f64 {
        self.local_sdf(self.local(p))
    }

    /// Distance along the ray to the surface, between 0 and `limit`, and the normal where that is
    /// known already.
    fn meet(&self, from: DVec3, along: DVec3, limit: f64) -> Option<(f64, Option<DVec3>)> {
        let (o, d) = (self.local(from) - self.middle, self.inward(along));
        let inverse = d.recip();
        let (a, b) = ((-self.half - o) * inverse, (self.half - o) * inverse);
        let near = a.min(b);
        let enter = near.max_element();
        let leave = a.max(b).min_element();
        if enter > leave || leave < 0.0 || enter > limit {
            return None;
        }
        let exact = matches!(self.thing, Thing::Furniture(_) | Thing::Clutter(Clutter::Sheet { .. }));
        if exact {
            let axis = if near.x >= near.y.max(near.z) {
                DVec3::X
            } else if near.y >= near.z {
                DVec3::Y
            } else {
                DVec3::Z
            };
            return (enter > 0.0).then(|| (enter, Some(self.outward(-d.signum() * axis))));
        }
        let (mut t, leave) = (enter.max(0.0), leave.min(limit));
        let o = o + self.middle;
        for _ in 0..80 {
            let h = self.local_sdf(o + d * t);
            if h < 1e-4 {
                return Some((t, None));
            }
            t += h;
            if t > leave {
                return None;
            }
        }
        None
    }

    /// Outward normal at a stage point on the surface.
    pub(crate) fn normal(&self, p: DVec3) -> DVec3 {
        const STEP: f64 = 3e-4;
        let q = self.local(p);
        let at = |x: f64, y: f64, z: f64| {
            let k = DVec3::new(x, y, z);
            k * self.local_sdf(q + k * STEP)
        };
        let sum = at(1.0, -1.0, -1.0) + at(-1.0, -1.0, 1.0) + at(-1.0, 1.0, -1.0) + at(1.0, 1.0, 1.0);
        self.outward(sum.normalize_or(DVec3::Z))
    }

    fn material(&self, p: DVec3, n: DVec3) -> Material {
        let (q, m) = (self.local(p), self.inward(n));
        match &self.thing {
            Thing::Target => watering_can::material(q),
            Thing::Clutter(clutter) => clutter.material(q, m),
            Thing::Furniture(piece) => piece.material(q - self.middle, m, self.half),
        }
    }
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
}

/// The target comes first.
pub(crate) const TARGET: usize = 0;

impl Stage {
    pub(crate) fn new() -> Self {
        let mut props = vec![Prop::new(
            Thing::Target,
            DVec3::new(0.0, -0.01, 0.0),
            TARGET_TURN_DEGREES,
            (watering_can::HALF, watering_can::CENTRE),
        )];
        for (piece, middle, degrees, half) in furniture() {
            props.push(Prop::new(Thing::Furniture(piece), middle, degrees, (half, DVec3::ZERO)));
        }
        for (clutter, x, y, z, degrees) in clutter() {
            let bounds = clutter.bounds();
            props.push(Prop::new(Thing::Clutter(clutter), DVec3::new(x, y, z), degrees, bounds));
        }
        Self { props }
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
        Hit { t, point, normal, prop: best }
    }

    pub(crate) fn material(&self, hit: &Hit) -> Material {
        match hit.prop {
            Some(index) => self.props[index].material(hit.point, hit.normal),
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

/// Turn of the target on the table.
const TARGET_TURN_DEGREES: f64 = 24.0;

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

/// Piece, middle, turn in degrees, half extents.
fn furniture() -> Vec<(Furniture, DVec3, f64, DVec3)> {
    let v = DVec3::new;
    let mut pieces = vec![
        (Furniture::TableTop, v(0.0, 0.0, -0.016), 0.0, v(0.75, 0.5, 0.016)),
        (Furniture::Bookshelf, v(0.25, 2.04, -0.10), 0.0, v(1.0, 0.16, 0.65)),
        (Furniture::Sideboard, v(-2.06, -0.1, -0.35), 0.0, v(0.24, 0.85, 0.40)),
        (Furniture::Cushion, v(1.65, 0.2, -0.55), 0.0, v(0.42, 0.85, 0.20)),
        (Furniture::Cushion, v(1.96, 0.2, -0.25), 0.0, v(0.14, 0.95, 0.35)),
        (Furniture::Cushion, v(1.62, 1.12, -0.35), 0.0, v(0.46, 0.10, 0.28)),
        (Furniture::Picture, v(0.5, -1.93, -0.35), 0.0, v(0.50, 0.02, 0.40)),
        (Furniture::Picture, v(-0.62, -1.95, -0.45), 0.0, v(0.30, 0.02, 0.28)),
        (Furniture::Stool, v(-0.35, -1.05, -0.32), 25.0, v(0.19, 0.19, 0.02)),
        (Furniture::Stool, v(-1.6, 1.4, -0.42), 20.0, v(0.22, 0.30, 0.33)),
    ];
    for (x, y) in [(-0.68, -0.43), (0.68, -0.43), (-0.68, 0.43), (0.68, 0.43)] {
        pieces.push((Furniture::TableLeg, v(x, y, -0.391), 0.0, v(0.03, 0.03, 0.359)));
    }
    for (x, y) in [(-0.47, -1.10), (-0.30, -1.17), (-0.40, -0.93), (-0.23, -1.0)] {
        pieces.push((Furniture::TableLeg, v(x, y, -0.545), 25.0, v(0.018, 0.018, 0.205)));
    }
    pieces
}

/// Thing, place of its foot and turn in degrees.
fn clutter() -> Vec<(Clutter, f64, f64, f64, f64)> {
    use Clutter::{Apple, Book, Carton, Cube, Mug, Orange, Pencil, Sheet};
    let v = DVec3::new;
    let book = |x, y, z, cover| Book { half: v(x, y, z), cover };
    vec![
        (book(0.080, 0.115, 0.016, 0), 0.05, 0.275, 0.0, 78.0),
        (book(0.068, 0.098, 0.013, 1), 0.04, 0.285, 0.032, 96.0),
        (book(0.062, 0.088, 0.010, 2), 0.055, 0.28, 0.058, 70.0),
        (book(0.075, 0.105, 0.014, 3), -0.36, -0.27, 0.0, 30.0),
        (Orange, 0.205, -0.175, 0.0, 0.0),
        (Orange, 0.275, -0.225, 0.0, 140.0),
        (Apple, -0.205, 0.135, 0.0, 30.0),
        (Mug, 0.335, 0.055, 0.0, 200.0),
        (Carton { half: v(0.045, 0.030, 0.068) }, -0.285, 0.045, 0.0, 28.0),
        (Pencil { colour: 0xd9a21b }, 0.02, -0.205, 0.0012, 12.0),
        (Pencil { colour: 0x2f6b45 }, -0.06, -0.262, 0.0012, -24.0),
        (Pencil { colour: 0xb23a32 }, -0.35, -0.26, 0.028, 70.0),
        (Cube { half: 0.020, look: 0 }, -0.175, -0.125, 0.0, 15.0),
        (Cube { half: 0.020, look: 1 }, -0.230, -0.135, 0.0, 52.0),
        (Cube { half: 0.020, look: 2 }, -0.203, -0.128, 0.040, 35.0),
        (Sheet { half: v(0.115, 0.085, 0.0006), look: 1 }, 0.03, -0.245, 0.0, 14.0),
        (Sheet { half: v(0.075, 0.052, 0.0006), look: 0 }, -0.13, 0.30, 0.0, -38.0),
        (Sheet { half: v(0.150, 0.110, 0.0006), look: 3 }, 0.50, 0.28, 0.0, 64.0),
        (Sheet { half: v(0.105, 0.150, 0.0006), look: 4 }, -0.56, 0.24, 0.0, 10.0),
        (book(0.085, 0.120, 0.018, 4), 0.52, -0.28, 0.0, -34.0),
        (Apple, 0.50, -0.27, 0.036, 80.0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every thing on the table stands apart from the target.
    #[test]
    fn nothing_runs_into_the_target() {
        let stage = Stage::new();
        let target = stage.target();
        let steps = |half: f64| (0..=40).map(move |i| half * (f64::from(i) / 20.0 - 1.0));
        for (index, prop) in stage.props.iter().enumerate().skip(1) {
            for x in steps(watering_can::HALF.x) {
                for y in steps(watering_can::HALF.y) {
                    for z in steps(watering_can::HALF.z) {
                        let p = target.place(watering_can::CENTRE + DVec3::new(x, y, z));
                        let clear = target.sdf(p) > 0.0 || prop.sdf(p) > -1e-9;
                        assert!(clear, "prop {index} meets the target at {p}");
                    }
                }
            }
        }
    }

    #[test]
    fn rays_stop_on_surfaces() {
        let stage = Stage::new();
        let eye = DVec3::new(0.5, -0.4, 0.4);
        for i in 0..400 {
            let aim = DVec3::new(f64::from(i % 20) * 0.05 - 0.5, f64::from(i / 20) * 0.05 - 0.5, 0.03);
            let along = (aim - eye).normalize();
            let hit = stage.trace(eye, along, Seen::Everything);
            assert!(stage.distance(hit.prop, hit.point).abs() < 2e-4, "{aim}");
            assert!(hit.normal.dot(along) < 0.2, "{aim} {:?}", hit);
        }
    }
}
