//! Marching: the intervals that the CPU finds.

use burn::tensor::{Device, Int, Tensor};
use glam::Vec3;
use neus_render::{
    contraction::uncontract,
    march::{
        DeviceGrids, DeviceIntervals, Grids, Intervals, Jitter, MarchConfig, march,
        march_on_device, rays_on,
    },
    occupancy::{DeviceBits, OccupancyGrid},
    random::unit_float,
    rays::Ray,
};

use crate::support::gpu;

/// Rays whose intervals may be others than the CPU's: where a midpoint is within a rounding or so of a cell's face,
/// 1e-6 of a cell's edge, devices may see it on the other side. A ray has some 500 midpoints here, and three
/// coordinates each: one ray in a thousand.
const UNLIKE: f32 = 0.01;

/// What such rays may do to the length of all intervals together, as a part of it: one step of 300, in one ray of a
/// thousand at most, and as many are lost as are won.
const LENGTH: f64 = 1e-4;

/// What distances may differ by: some roundings of the distance itself, and outside the box of `d / (d + 1)`, of
/// which the distance is `(d + 1)^2` times as steep a function.
fn distance_tolerance(t: f32) -> f32 {
    1e-6 * (1.0 + t) + 3e-7 * (1.0 + t) * (1.0 + t)
}

/// The GPU's intervals on the host.
struct Found {
    intervals: Intervals,
    /// Everything that was in the places for intervals, used or not.
    places: [Vec<f32>; 2],
    ray_count: usize,
}

fn words(tensor: Tensor<1, Int>) -> Vec<u32> {
    let words = tensor.into_data().try_to_vec::<i32>().unwrap();
    words.into_iter().map(|word| word as u32).collect()
}

impl Found {
    fn read(found: DeviceIntervals) -> Self {
        let floats = |tensor: Tensor<1>| tensor.into_data().try_to_vec::<f32>().unwrap();
        let (t, dt) = (floats(found.t), floats(found.dt));
        let flags = words(found.flags);
        let ray_offsets = words(found.ray_offsets);
        let n = ray_offsets[ray_offsets.len() - 1] as usize;
        // Behind the last interval there is nothing.
        assert!(t[n..].iter().chain(&dt[n..]).all(|value| *value == 0.0));
        assert!(flags[n..].iter().all(|flag| *flag == 0));
        let has = |bit: u32| flags[..n].iter().map(|flag| flag & bit != 0).collect();
        Self {
            intervals: Intervals {
                ray_offsets,
                t: t[..n].to_vec(),
                dt: dt[..n].to_vec(),
                object: has(DeviceIntervals::OBJECT),
                background: has(DeviceIntervals::BACKGROUND),
            },
            places: [t, dt],
            ray_count: words(found.ray_count)[0] as usize,
        }
    }
}

fn on_gpu(
    device: &Device,
    rays: &[Ray],
    grids: Grids<'_>,
    config: &MarchConfig,
    capacity: usize,
) -> Found {
    let [object, background] = [grids.object, grids.background]
        .map(|grid| grid.map(|grid| DeviceBits::upload(grid, device)));
    let grids = DeviceGrids {
        object: object.as_ref(),
        background: background.as_ref(),
    };
    let rays = rays_on(device, rays);
    Found::read(march_on_device(rays, grids, config, capacity))
}

/// Cells of which `chosen` says that they are occupied.
fn grid(resolution: u32, half: f32, chosen: impl Fn(u32, Vec3) -> bool) -> OccupancyGrid {
    let mut grid = OccupancyGrid::new(resolution, half);
    let cells: Vec<u32> = (0..grid.cell_count() as u32)
        .filter(|&cell| chosen(cell, grid.centre_of(cell)))
        .collect();
    grid.update(&cells, &vec![1.0; cells.len()]);
    grid.rebuild_bits(0.5);
    grid
}

/// An object's grid and a background's: a sphere before a floor and a far wall, noise, everything, nothing. Odd
/// resolutions, and one grid that is smaller than the box.
fn scenes() -> [(&'static str, OccupancyGrid, OccupancyGrid); 4] {
    let noise = |seed: u64| move |cell: u32, _: Vec3| unit_float(seed, u64::from(cell)) < 0.3;
    [
        (
            "a sphere on a floor",
            grid(64, 1.0, |_, p| (p.length() - 0.5).abs() < 0.05),
            grid(65, 2.0, |_, p| {
                let far = uncontract(p).length();
                (p.y - 0.5).abs() < 0.05 || (far > 4.0 && far < 8.0)
            }),
        ),
        ("noise", grid(31, 0.7, noise(1)), grid(24, 2.0, noise(2))),
        (
            "all occupied",
            grid(16, 1.0, |_, _| true),
            grid(16, 2.0, |_, _| true),
        ),
        (
            "none occupied",
            grid(16, 1.0, |_, _| false),
            grid(16, 2.0, |_, _| false),
        ),
    ]
}

/// Rays from everywhere: most meet the box, some begin inside it, some pass it by.
fn rays(count: usize) -> Vec<Ray> {
    let vector = |seed: u64, i: usize| {
        Vec3::from([0, 1, 2].map(|axis| 2.0 * unit_float(seed, 3 * i as u64 + axis) - 1.0))
    };
    (0..count)
        .map(|i| {
            let origin = 3.0 * vector(11, i);
            let target = 1.5 * vector(12, i);
            Ray::new(origin, target - origin).unwrap()
        })
        .collect()
}

fn base() -> MarchConfig {
    MarchConfig {
        step_object: 0.01,
        jitter: Jitter::Seeded(7),
        ..MarchConfig::default()
    }
}

fn configs() -> [MarchConfig; 4] {
    [
        base(),
        MarchConfig {
            jitter: Jitter::Fixed,
            behind_box: false,
            ..base()
        },
        MarchConfig {
            background_stride: 4,
            background_samples: 7,
            near: 1.7,
            far: 40.0,
            ..base()
        },
        // Most rays have to be marched with longer steps, some with the longest.
        MarchConfig {
            max_intervals_per_ray: 30,
            ..base()
        },
    ]
}

/// The lengths of all that is to be asked of either field, far away left out: there the lengths are.
fn lengths(intervals: &Intervals) -> [f64; 2] {
    [&intervals.object, &intervals.background].map(|flags| {
        let all = intervals.t.iter().zip(&intervals.dt).zip(flags);
        all.filter(|((t, _), flag)| **flag && **t < 8.0)
            .map(|((_, dt), _)| f64::from(*dt))
            .sum()
    })
}

fn assert_alike(what: &str, found: &Intervals, expected: &Intervals) {
    let count = expected.ray_count();
    assert_eq!(found.ray_count(), count, "{what}: rays");
    assert!(found.ray_offsets.is_sorted(), "{what}: offsets");
    let range = |intervals: &Intervals, ray: usize| {
        intervals.ray_offsets[ray] as usize..intervals.ray_offsets[ray + 1] as usize
    };
    let mut unlike = 0;
    for ray in 0..count {
        let (f, e) = (range(found, ray), range(expected, ray));
        let same_flags = found.object[f.clone()] == expected.object[e.clone()]
            && found.background[f.clone()] == expected.background[e.clone()];
        if f.len() != e.len() || !same_flags {
            unlike += 1;
            continue;
        }
        for (f, e) in f.zip(e) {
            let tolerance = distance_tolerance(expected.t[e] + expected.dt[e]);
            let (dt, length) = (found.dt[f] - expected.dt[e], expected.dt[e]);
            let t = found.t[f] - expected.t[e];
            assert!(
                t.abs() <= tolerance && dt.abs() <= 2.0 * tolerance,
                "{what}: ray {ray}, {} instead of {}, {} instead of {length}",
                found.t[f],
                expected.t[e],
                found.dt[f]
            );
        }
    }
    assert!(
        unlike as f32 <= UNLIKE * count as f32,
        "{what}: {unlike} of {count} rays have other intervals"
    );
    for (found, expected) in lengths(found).into_iter().zip(lengths(expected)) {
        assert!(
            (found - expected).abs() <= LENGTH * expected,
            "{what}: a length of {found} instead of {expected}"
        );
    }
}

#[test]
fn intervals_are_those_of_the_cpu() {
    let Some(gpu) = gpu() else {
        return;
    };
    for (name, object, background) in &scenes() {
        let (object, background) = (Some(object), Some(background));
        for (object, background) in [(object, background), (object, None), (None, background)] {
            let grids = Grids { object, background };
            for (number, config) in configs().iter().enumerate() {
                for count in [1, 65, 1000] {
                    let rays = rays(count);
                    let expected = march(&rays, grids, config);
                    let found = on_gpu(&gpu, &rays, grids, config, expected.len() + 999);
                    let fields = (object.is_some(), background.is_some());
                    let what = format!("{name}, {fields:?}, config {number}, {count} rays");
                    assert_alike(&what, &found.intervals, &expected);
                    assert_eq!(found.ray_count, count, "{what}: they all fit");
                }
            }
        }
    }
}

#[test]
fn rays_with_too_many_intervals_have_longer_ones() {
    let Some(gpu) = gpu() else {
        return;
    };
    let [_, _, (_, object, background), _] = &scenes();
    let grids = Grids {
        object: Some(object),
        background: Some(background),
    };
    let rays = rays(200);
    // The last two are cut off: steps are not doubled for ever.
    for most in [500, 100, 9, 1, 0] {
        let config = MarchConfig {
            max_intervals_per_ray: most,
            step_object: 0.002,
            ..base()
        };
        let expected = march(&rays, grids, &config);
        let found = on_gpu(&gpu, &rays, grids, &config, 200 * 500);
        assert_alike(&format!("at most {most}"), &found.intervals, &expected);
        let offsets = &found.intervals.ray_offsets;
        let longest = offsets.windows(2).map(|ends| ends[1] - ends[0]).max();
        assert!(longest <= Some(most as u32), "{longest:?} above {most}");
    }
}

#[test]
fn what_does_not_fit_is_cut_off_ray_by_ray() {
    let Some(gpu) = gpu() else {
        return;
    };
    let [(_, object, background), ..] = &scenes();
    let grids = Grids {
        object: Some(object),
        background: Some(background),
    };
    let rays = rays(301);
    let all = on_gpu(&gpu, &rays, grids, &base(), 1 << 20);
    let offsets = &all.intervals.ray_offsets;
    let n = all.intervals.len();
    assert!(n > 1000 && all.ray_count == 301, "{n} intervals");
    for capacity in [
        n,
        n - 1,
        n / 2,
        offsets[150] as usize,
        offsets[1] as usize - 1,
        1,
    ] {
        let cut = on_gpu(&gpu, &rays, grids, &base(), capacity);
        let fitting = (0..=301)
            .rev()
            .find(|ray| offsets[*ray] as usize <= capacity);
        let fitting = fitting.unwrap();
        assert_eq!(cut.ray_count, fitting, "a capacity of {capacity}");
        let expected: Vec<u32> = (0..=301).map(|ray| offsets[ray.min(fitting)]).collect();
        assert_eq!(cut.intervals.ray_offsets, expected);
        let kept = offsets[fitting] as usize;
        assert_eq!(cut.intervals.t, all.intervals.t[..kept]);
        assert_eq!(cut.intervals.dt, all.intervals.dt[..kept]);
        assert_eq!(cut.intervals.object, all.intervals.object[..kept]);
        assert_eq!(cut.intervals.background, all.intervals.background[..kept]);
        assert_eq!(cut.places.map(|list| list.len()), [capacity; 2]);
    }
}

#[test]
fn no_rays_have_no_intervals() {
    let Some(gpu) = gpu() else {
        return;
    };
    let [(_, object, _), ..] = &scenes();
    let grids = Grids {
        object: Some(object),
        background: None,
    };
    let found = on_gpu(&gpu, &[], grids, &base(), 5);
    assert_eq!(found.intervals.ray_offsets, [0]);
    assert_eq!(found.ray_count, 0);
    // And no grids.
    let found = on_gpu(&gpu, &rays(3), Grids::default(), &base(), 5);
    assert_eq!(found.intervals.ray_offsets, [0; 4]);
    assert_eq!(found.ray_count, 3);
}

/// Rays that no camera has: not a number, without a direction, along faces and edges of the box.
#[test]
fn odd_rays_are_marched_as_on_the_cpu() {
    let Some(gpu) = gpu() else {
        return;
    };
    let nan = Vec3::splat(f32::NAN);
    let mut odd = Vec::new();
    for origin in [
        Vec3::new(0.1, 0.2, -3.0),
        Vec3::new(1.0, 1.0, -4.0),
        Vec3::new(f32::NAN, 0.2, -3.0),
        Vec3::new(0.1, 0.2, f32::NAN),
        Vec3::new(0.1, f32::INFINITY, -3.0),
        Vec3::ZERO,
        nan,
    ] {
        for direction in [
            Vec3::Z,
            Vec3::NEG_Z,
            Vec3::new(0.0, -0.0, -1.0),
            Vec3::new(f32::NAN, 0.0, 1.0),
            Vec3::new(0.6, f32::NAN, 0.8),
            Vec3::ZERO,
            nan,
        ] {
            odd.push(Ray { origin, direction });
        }
    }
    for (name, object, background) in &scenes() {
        let grids = Grids {
            object: Some(object),
            background: Some(background),
        };
        for ray in &odd {
            let expected = march(&[*ray], grids, &base());
            let found = on_gpu(&gpu, &[*ray], grids, &base(), 4000).intervals;
            let what = format!("{name}, {ray:?}");
            assert_eq!(found.ray_offsets, expected.ray_offsets, "{what}");
            assert!(found.t.iter().all(|t| t.is_finite()), "{what}");
            assert_alike(&what, &found, &expected);
        }
    }
}

/// More than 65535 workgroups of 64.
#[test]
fn a_batch_may_need_more_workgroups_than_an_axis_holds() {
    let Some(gpu) = gpu() else {
        return;
    };
    let [_, (_, object, background), ..] = &scenes();
    let grids = Grids {
        object: Some(object),
        background: Some(background),
    };
    let config = MarchConfig {
        step_object: 0.9,
        background_samples: 2,
        jitter: Jitter::Fixed,
        ..base()
    };
    let few = rays(100);
    let many: Vec<Ray> = few
        .iter()
        .cycle()
        .take(65_536 * 64 + 1000)
        .copied()
        .collect();
    let once = on_gpu(&gpu, &few, grids, &config, 1000).intervals;
    let n = once.len();
    let found = on_gpu(&gpu, &many, grids, &config, n * many.len().div_ceil(100));
    assert!(n > 100 && found.ray_count == many.len());
    for (i, offset) in found.intervals.ray_offsets.iter().enumerate() {
        let expected = i / 100 * n + once.ray_offsets[i % 100] as usize;
        assert_eq!(*offset as usize, expected, "ray {i}");
    }
    for (i, chunk) in found.intervals.t.chunks(n).enumerate() {
        assert!(chunk == &once.t[..chunk.len()], "rays from {}", 100 * i);
    }
}
