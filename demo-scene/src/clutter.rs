//! The other things on the table, each in its own frame: standing at the origin, z up, metres.

use glam::{DVec2, DVec3};

use crate::noise::{fbm2, fbm3, floor, hash3, smoothstep, speckle3, unit, value2};
use crate::paint::{Material, ink, mix, mottle, rgb};
use crate::primitives::{arc, capsule, frustum, rounded_box, smooth_max, smooth_min};

/// One thing on the table.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Clutter {
    /// A hardback; the number picks its cover.
    Book {
        half: DVec3,
        cover: u32,
    },
    Orange,
    Apple,
    Mug,
    /// A striped carton.
    Carton {
        half: DVec3,
    },
    Pencil {
        colour: u32,
    },
    /// A painted toy cube.
    Cube {
        half: f64,
        look: u32,
    },
    /// A printed sheet.
    Sheet {
        half: DVec3,
        look: u32,
    },
    /// A disc with a printed mat on it.
    Turntable {
        radius: f64,
        half: f64,
    },
}

impl Clutter {
    /// Half extents and centre of a box around the thing.
    pub(crate) fn bounds(&self) -> (DVec3, DVec3) {
        match *self {
            Self::Book { half, .. } | Self::Carton { half } | Self::Sheet { half, .. } => {
                (half, DVec3::Z * half.z)
            }
            Self::Orange => (DVec3::splat(0.0385), DVec3::Z * 0.038),
            Self::Apple => (DVec3::new(0.041, 0.041, 0.042), DVec3::Z * 0.042),
            Self::Mug => (
                DVec3::new(0.062, 0.042, 0.048),
                DVec3::new(0.020, 0.0, 0.047),
            ),
            Self::Pencil { .. } => (DVec3::new(0.09, 0.0042, 0.0042), DVec3::Z * 0.004),
            Self::Cube { half, .. } => (DVec3::splat(half), DVec3::Z * half),
            Self::Turntable { radius, half } => (DVec3::new(radius, radius, half), DVec3::Z * half),
        }
    }

    /// Signed distance.
    pub(crate) fn sdf(&self, p: DVec3) -> f64 {
        match *self {
            Self::Book { half, .. } => book(p, half),
            Self::Orange => (p - DVec3::Z * 0.038).length() - 0.038,
            Self::Apple => {
                let q = DVec2::new(p.truncate().length(), p.z - 0.033);
                // Wider at the shoulders, with a dip where the stem sits.
                let flesh = DVec2::new(q.x - 0.010, q.y * 0.97).length() - 0.0295;
                let stem = capsule(
                    p,
                    DVec3::new(0.0, 0.0, 0.055),
                    DVec3::new(0.005, 0.002, 0.078),
                    0.0016,
                    0.002,
                );
                smooth_min(flesh, stem, 0.003)
            }
            Self::Mug => {
                let q = DVec2::new(p.truncate().length(), p.z);
                let inside = frustum(q - DVec2::new(0.0, 0.055), 0.048, 0.032, 0.0375);
                smooth_max(solid_mug(p), -inside, 0.002)
            }
            Self::Carton { half } => rounded_box(p - DVec3::Z * half.z, half, 0.002),
            Self::Pencil { .. } => {
                let shaft = capsule(
                    p,
                    DVec3::new(-0.086, 0.0, 0.004),
                    DVec3::new(0.066, 0.0, 0.004),
                    0.004,
                    0.004,
                );
                shaft.min(capsule(
                    p,
                    DVec3::new(0.064, 0.0, 0.004),
                    DVec3::new(0.087, 0.0, 0.004),
                    0.004,
                    0.0009,
                ))
            }
            Self::Cube { half, .. } => rounded_box(p - DVec3::Z * half, DVec3::splat(half), 0.003),
            Self::Sheet { half, .. } => rounded_box(p - DVec3::Z * half.z, half, 0.0),
            Self::Turntable { radius, half } => {
                let q = DVec2::new(p.truncate().length(), p.z - half);
                frustum(q, half, radius, radius)
            }
        }
    }

    /// Signed distance to the thing without its hollow.
    pub(crate) fn filled_sdf(&self, p: DVec3) -> f64 {
        match self {
            Self::Mug => solid_mug(p),
            _ => self.sdf(p),
        }
    }

    /// Colour at a surface point with normal `n`.
    pub(crate) fn material(&self, p: DVec3, n: DVec3) -> Material {
        match *self {
            Self::Book { half, cover } => book_paint(p, n, half, cover),
            Self::Orange => {
                let pores = speckle3(p / 0.0042, 0.8, 0.4, 20);
                let skin = mix(
                    rgb(0xe8871a),
                    rgb(0xd9650c),
                    smoothstep(-0.4, 0.4, fbm3(p / 0.02, 3, 21)),
                );
                let navel = smoothstep(0.006, 0.002, (p - DVec3::new(0.012, 0.01, 0.073)).length());
                Material::glossy(mix(skin * (1.0 - 0.35 * pores), rgb(0x5b6b2a), navel), 0.16)
            }
            Self::Apple => {
                let streak = fbm3(DVec3::new(p.x / 0.007, p.y / 0.007, p.z / 0.04), 3, 22);
                let blush = smoothstep(-0.35, 0.35, streak + 25.0 * p.x);
                let skin = mix(rgb(0xc9b84a), rgb(0xa3231f), blush);
                let dots = speckle3(p / 0.006, 0.6, 0.22, 23);
                let stem = p.z > 0.058 && p.truncate().length() < 0.006;
                Material::glossy(
                    if stem {
                        rgb(0x4a3320)
                    } else {
                        mix(skin, rgb(0xead9a0), 0.7 * dots)
                    },
                    0.3,
                )
            }
            Self::Mug => mug_paint(p),
            Self::Carton { half } => carton_paint(p, n, half),
            Self::Pencil { colour } => {
                let wood = mottle(rgb(0xd7ae78), p, 0.004, 0.3, 24);
                let paint = mottle(rgb(colour), p, 0.006, 0.3, 25);
                let bands = ink((p.x + 0.074).abs() - 0.004);
                let body = mix(paint, rgb(0xb9b4a8), bands);
                let tip = if p.x > 0.081 { rgb(0x222222) } else { wood };
                Material::glossy(
                    if p.x > 0.066 {
                        tip
                    } else if p.x < -0.079 {
                        rgb(0xc77a76)
                    } else {
                        body
                    },
                    0.2,
                )
            }
            Self::Cube { half, look } => cube_paint(p, n, half, look),
            Self::Sheet { half, look } => sheet_paint(p, half, look),
            Self::Turntable { radius, half } => mat_paint(p, radius, half),
        }
    }
}

/// The mug before it is hollowed out.
fn solid_mug(p: DVec3) -> f64 {
    let q = DVec2::new(p.truncate().length(), p.z);
    let outside = frustum(q - DVec2::new(0.0, 0.047), 0.044, 0.034, 0.038) - 0.003;
    let from = p - DVec3::new(0.042, 0.0, 0.048);
    let handle = arc(
        DVec3::new(from.z, from.x, p.y),
        DVec2::new(1.0, 0.0),
        0.027,
        0.0055,
    );
    smooth_min(outside, handle, 0.006)
}

/// Two boards and a spine around a slightly smaller block of pages.
fn book(p: DVec3, half: DVec3) -> f64 {
    const BOARD: f64 = 0.0016;
    let q = p - DVec3::Z * half.z;
    let pages = rounded_box(q, half - DVec3::new(0.004, 0.004, 0.001), 0.001);
    let edge = q - DVec3::Z * (half.z - BOARD) * if q.z < 0.0 { -1.0 } else { 1.0 };
    let boards = rounded_box(edge, DVec3::new(half.x, half.y, BOARD), 0.0012);
    let spine = rounded_box(
        q + DVec3::X * (half.x - BOARD),
        DVec3::new(BOARD, half.y, half.z),
        0.0012,
    );
    pages.min(boards).min(spine)
}

fn book_paint(p: DVec3, n: DVec3, half: DVec3, cover: u32) -> Material {
    let inner = p - DVec3::Z * half.z;
    let on_pages = inner.x > half.x - 0.0045 || inner.y.abs() > half.y - 0.0045;
    if n.z.abs() < 0.5 && on_pages && inner.z.abs() < half.z - 0.0033 {
        let leaf = value2(DVec2::new(p.z / 0.0012, (p.x + p.y) / 0.05), 30 + cover);
        return Material::matt(mottle(rgb(0xd9cdb0), p, 0.01, 0.15, 31) * (0.86 + 0.2 * leaf));
    }
    let cloth = [0x7a2430, 0x23456e, 0xc9a44a, 0x2f5a3c, 0x4b3b63][cover as usize % 5];
    let second = [0xe6cf9a, 0xdb8b3a, 0x5a2a1d, 0xe8dfc8, 0xd8b65a][cover as usize % 5];
    let mut colour = mottle(rgb(cloth), p, 0.0035, 0.38, 32 + cover);
    colour = mottle(colour, p, 0.03, 0.22, 33);
    let accent = mottle(rgb(second), p, 0.004, 0.3, 34);
    if n.z > 0.5 {
        // A framed picture and lines of lettering.
        let q = inner.truncate() / DVec2::new(half.x, half.y);
        let frame = q.abs().max_element();
        colour = mix(colour, accent, ink((frame - 0.86).abs() * half.y - 0.0014));
        let scene = fbm2(inner.truncate() / 0.022, 4, 40 + cover);
        if q.x > -0.62 && q.x < 0.30 && q.y.abs() < 0.66 {
            let hill = if scene + 0.8 * q.x > -0.1 {
                accent
            } else {
                rgb(0x8fa9a6)
            };
            colour = mottle(
                mix(
                    hill,
                    rgb(0x2b2a33),
                    ink(0.006 * (scene - 0.32).abs() - 0.0007),
                ),
                p,
                0.004,
                0.3,
                41,
            );
        } else if q.x > 0.40 && q.x < 0.78 && q.y.abs() < 0.70 {
            colour = mix(
                colour,
                accent,
                lettering(DVec2::new(inner.y, inner.x), 0.012, 42 + cover),
            );
        }
    } else if inner.x < 0.0 && n.x < -0.5 {
        colour = mix(
            colour,
            accent,
            lettering(DVec2::new(inner.y, inner.z), 0.010, 43 + cover),
        );
    }
    Material {
        albedo: colour,
        gloss: 0.10,
        sharpness: 4,
    }
}

/// Coverage by rows of made-up letters, `pitch` metres apart.
fn lettering(q: DVec2, pitch: f64, seed: u32) -> f64 {
    let row = floor(q.y / pitch);
    let v = q.y / pitch - f64::from(row) - 0.5;
    let u = q.x / (0.62 * pitch);
    let letter = floor(u);
    let h = hash3(letter, row, 1, seed);
    if h.is_multiple_of(6) {
        return 0.0;
    }
    let x = u - f64::from(letter) - 0.5;
    let stroke = |bit: u32, d: f64| if h >> bit & 1 == 1 { d } else { f64::MAX };
    let tall = 0.30;
    let upright = |at: f64| (x - at).abs().max(v.abs() - tall);
    let level = |at: f64| (v - at).abs().max(x.abs() - 0.30);
    let d = upright(-0.25)
        .min(stroke(8, upright(0.25)))
        .min(stroke(9, level(tall)))
        .min(stroke(10, level(0.0)))
        .min(stroke(11, level(-tall)))
        - 0.10;
    smoothstep(0.06, -0.06, d)
}

fn mug_paint(p: DVec3) -> Material {
    let r = p.truncate().length();
    let base = mottle(rgb(0xded3bd), p, 0.012, 0.22, 50);
    let spots = speckle3(p / 0.0072, 0.6, 0.25, 51);
    let speckled = mix(base, rgb(0x4b3526), 0.8 * spots);
    if r < 0.0335 && p.z > 0.02 {
        // Coffee-stained inside.
        return Material::glossy(
            mix(speckled, rgb(0x5b3a22), smoothstep(0.07, 0.03, p.z)),
            0.2,
        );
    }
    let wave = 0.004 * fbm3(DVec3::new(p.x / 0.012, p.y / 0.012, 0.0), 2, 52);
    let s = (p.z + wave) / 0.0165;
    let band = floor(s);
    let colour = [0x2e4f7c, 0xb3402f, 0xded3bd, 0x3b6e62][(hash3(band, 0, 0, 53) % 4) as usize];
    let inside = ink((s - f64::from(band) - 0.5).abs() * 0.0165 - 0.0058);
    let striped = mix(
        speckled,
        mottle(rgb(colour), p, 0.005, 0.4, 54),
        if r < 0.046 { inside } else { 0.0 },
    );
    Material::glossy(striped, 0.28)
}

fn carton_paint(p: DVec3, n: DVec3, half: DVec3) -> Material {
    let print = |c: u32| mottle(mottle(rgb(c), p, 0.004, 0.30, 55), p, 0.025, 0.2, 56);
    // The face's own coordinates, origin at its centre.
    let q = p - DVec3::Z * half.z;
    let (face, size) = if n.z.abs() > 0.7 {
        (DVec2::new(q.x, q.y), DVec2::new(half.x, half.y))
    } else if n.x.abs() > n.y.abs() {
        (DVec2::new(q.y, q.z), DVec2::new(half.y, half.z))
    } else {
        (DVec2::new(q.x, q.z), DVec2::new(half.x, half.z))
    };
    let s = (face.x + 0.7 * face.y) / 0.017;
    let stripe = floor(s);
    let wide = 0.25 + 0.22 * unit(hash3(stripe, 0, 1, 57));
    let inside = ink(((s - f64::from(stripe) - 0.5).abs() - wide) * 0.014);
    let mut colour = mix(
        print(0xe9e1d2),
        print(if stripe & 1 == 0 { 0xc4372f } else { 0xd98a2b }),
        inside,
    );
    let label = (face / size).abs().max_element() - 0.62;
    if label < 0.0 && n.z < 0.7 {
        colour = mix(print(0xf0e7cf), rgb(0x28324e), lettering(face, 0.0135, 58));
        let badge = (face - DVec2::new(0.012, 0.014)).length() - 0.011;
        colour = mix(colour, print(0x2f6b4a), ink(badge));
    }
    colour = mix(
        colour,
        rgb(0x28324e),
        ink(label.abs() * size.min_element() - 0.001),
    );
    Material {
        albedo: colour,
        gloss: 0.12,
        sharpness: 4,
    }
}

fn cube_paint(p: DVec3, n: DVec3, half: f64, look: u32) -> Material {
    let q = (p - DVec3::Z * half) / half;
    let (face, axis) = if n.z.abs() > 0.7 {
        (q.truncate(), 0)
    } else if n.x.abs() > n.y.abs() {
        (DVec2::new(q.y, q.z), if n.x > 0.0 { 1 } else { 2 })
    } else {
        (DVec2::new(q.x, q.z), if n.y > 0.0 { 3 } else { 4 })
    };
    let wood = mottle(
        mottle(
            rgb(0xcfa56b),
            p * DVec3::new(1.0, 4.0, 1.0),
            0.012,
            0.3,
            90 + look,
        ),
        p,
        0.003,
        0.2,
        91,
    );
    let paint = [0x2f6fb0, 0xc43b30, 0x3c8a4c, 0xd8a21e, 0x7b4a94][((look + axis) % 5) as usize];
    let paint = mottle(rgb(paint), p, 0.004, 0.35, 92);
    let border = face.abs().max_element();
    let mut colour = mix(wood, paint, ink((border - 0.82).abs() * half - 0.0018));
    if border < 0.7 {
        let letter = lettering(
            face * 0.5 + DVec2::new(0.31, 0.5),
            1.0,
            93 + look * 7 + axis,
        );
        colour = mix(colour, paint, letter);
    }
    Material {
        albedo: colour,
        gloss: 0.14,
        sharpness: 4,
    }
}

fn sheet_paint(p: DVec3, half: DVec3, look: u32) -> Material {
    let q = p.truncate();
    let fibre = mottle(mottle(rgb(0xddd5c2), p, 0.004, 0.12, 95), p, 0.05, 0.15, 96);
    let margin = half.truncate() - 0.010 - q.abs();
    if margin.min_element() < 0.0 {
        return Material::matt(fibre);
    }
    let picture = if look.is_multiple_of(2) {
        q.y > 0.02
    } else {
        q.x < -0.01
    };
    let colour = if picture {
        // A halftone landscape.
        let s = fbm2(q / 0.03 + DVec2::splat(f64::from(look)), 5, 97);
        let sky = mix(rgb(0x6f93ad), rgb(0xd9cfae), smoothstep(-0.3, 0.3, s));
        let land = mix(
            rgb(0x47602f),
            rgb(0x8b6a3a),
            smoothstep(-0.2, 0.4, fbm2(q / 0.01, 4, 98)),
        );
        if s * 0.05 + q.y - 0.4 * q.x > 0.03 {
            sky
        } else {
            land
        }
    } else {
        let column = floor(q.x / 0.052);
        let gap = (q.x / 0.052 - f64::from(column) - 0.5).abs() > 0.44;
        let pitch = if q.y > 0.0 { 0.0075 } else { 0.0055 };
        mix(
            fibre,
            rgb(0x2a2826),
            if gap {
                0.0
            } else {
                0.9 * lettering(q, pitch, 99 + look)
            },
        )
    };
    Material::matt(mottle(colour, p, 0.003, 0.15, 100))
}

/// A mat of coloured patches in rings, no two alike, on a dark disc.
fn mat_paint(p: DVec3, radius: f64, half: f64) -> Material {
    let rim = mottle(rgb(0x3a3c40), p, 0.004, 0.3, 90);
    let from_axis = p.truncate().length();
    if p.z < 1.99 * half || from_axis > 0.95 * radius {
        return Material::glossy(rim, 0.1);
    }
    let ring = floor(from_axis / 0.021);
    let patches = f64::from(5 * ring + 3);
    let turn = libm::atan2(p.y, p.x) / core::f64::consts::TAU + 0.5;
    let h = |k: i32| unit(hash3(ring, floor(turn * patches), k, 91));
    let hue = [0xd8cfb8, 0x9c4b36, 0x38597a, 0xc39a45, 0x57704b][(5.0 * h(0)) as usize % 5];
    let patch = rgb(hue) * (0.7 + 0.5 * h(1));
    Material::matt(mottle(mottle(patch, p, 0.003, 0.4, 92), p, 0.02, 0.25, 93))
}
