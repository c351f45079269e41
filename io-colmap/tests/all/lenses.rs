//! Projection and its inverse for every camera model.

use crate::sample::{Random, cameras};
use glam::{DVec2, DVec3};
use io_colmap::{Camera, CameraModel};

/// Rounding through Newton's method at a focal length of 500, in pixels.
const PIXEL_TOLERANCE: f64 = 1e-6;

#[test]
fn pixels_survive_the_round_trip_in_every_model() {
    for camera in cameras() {
        let mut seen = 0;
        for y in (0..=480).step_by(16) {
            for x in (0..=640).step_by(16) {
                let pixel = DVec2::new(f64::from(x), f64::from(y));
                let Some(ray) = camera.unproject(pixel) else {
                    continue;
                };
                assert!(ray.z == 1.0 || (ray.length() - 1.0).abs() < 1e-12);
                let back = camera.project(ray * 3.7).unwrap_or_else(|| {
                    panic!(
                        "{}: {pixel} looks along {ray}, which is not seen",
                        camera.model
                    )
                });
                assert!(
                    back.distance(pixel) < PIXEL_TOLERANCE,
                    "{}: {pixel} came back as {back}",
                    camera.model
                );
                seen += 1;
            }
        }
        // All of the picture is seen, but for panorama columns lost to rounding at the seam.
        assert!(
            seen >= 31 * 41 - 62,
            "{}: only {seen} pixels have a ray",
            camera.model
        );
    }
}

#[test]
fn points_survive_the_round_trip_in_every_model() {
    for camera in cameras() {
        let mut random = Random(11);
        for _ in 0..500 {
            let p = DVec3::new(
                random.signed(),
                random.signed(),
                1.6 + random.signed() * 0.4,
            );
            let pixel = camera.project(p).unwrap();
            let ray = camera.unproject(pixel).unwrap();
            assert!(
                (ray - p / p.z).length() < 1e-8,
                "{}: {p} came back as {ray}",
                camera.model
            );
        }
    }
}

/// A point through each sample camera, as COLMAP itself projects it (pycolmap 4.2.1,
/// `Camera.img_from_cam`).
#[test]
fn projections_agree_with_colmap() {
    let point = DVec3::new(0.31, -0.24, 0.9);
    let expected: [(&str, f64, f64); 18] = [
        ("SIMPLE_PINHOLE", 490.22222222222223, 109.66666666666666),
        ("PINHOLE", 490.22222222222223, 108.33333333333334),
        ("SIMPLE_RADIAL", 486.300658436214, 112.7027160493827),
        ("RADIAL", 484.05834699486866, 114.43869910074685),
        ("OPENCV", 483.27467185981135, 113.71332012487935),
        ("OPENCV_FISHEYE", 480.9268593602254, 115.601707390585),
        ("FULL_OPENCV", 486.8337812962644, 110.95660084693847),
        ("FOV", 491.46086525560247, 107.36479439368372),
        (
            "SIMPLE_RADIAL_FISHEYE",
            481.24497356700874,
            116.6167946577997,
        ),
        ("RADIAL_FISHEYE", 481.1987085011573, 116.65261277329756),
        ("THIN_PRISM_FISHEYE", 480.6340483611379, 116.00112758701354),
        (
            "RAD_TAN_THIN_PRISM_FISHEYE",
            481.44779915938915,
            115.30732134409936,
        ),
        ("SIMPLE_DIVISION", 485.5809178654331, 113.2599345557937),
        ("DIVISION", 485.5809178654331, 111.96253390135166),
        ("SIMPLE_FISHEYE", 480.42259634795323, 117.25347379513296),
        ("FISHEYE", 480.42259634795323, 115.9960085330843),
        ("EUCM", 480.52698265571144, 115.9143851750179),
        ("EQUIRECTANGULAR", 353.7884163485098, 202.26398712891523),
    ];
    for (camera, (name, x, y)) in cameras().iter().zip(expected) {
        assert_eq!(camera.model.name(), name);
        let pixel = camera.project(point).unwrap();
        assert!(
            pixel.distance(DVec2::new(x, y)) < 1e-9,
            "{name}: {pixel} instead of {x}, {y}"
        );
    }
}

#[test]
fn points_that_cannot_be_seen_have_no_pixel() {
    for camera in cameras() {
        for p in [
            DVec3::ZERO,
            DVec3::new(f64::NAN, 0.0, 1.0),
            DVec3::new(0.0, f64::INFINITY, 1.0),
            DVec3::new(0.0, 0.0, -1.0),
        ] {
            let panorama = camera.model == CameraModel::Equirectangular;
            assert!(
                panorama && p.z < 0.0 || camera.project(p).is_none(),
                "{} {p}",
                camera.model
            );
        }
        assert!(camera.unproject(DVec2::new(f64::NAN, 1.0)).is_none());
        assert!(
            camera
                .unproject(DVec2::splat(1e300))
                .is_none_or(|ray| ray.is_finite())
        );
    }
}

#[test]
fn a_folded_polynomial_sees_nothing_beyond_its_fold() {
    // r (1 - 0.4 r^2) turns back at r = 0.913; a point at r = 1.5 would land at r = 0.15.
    let camera = Camera {
        id: 1,
        model: CameraModel::SimpleRadial,
        width: 640,
        height: 480,
        params: vec![400.0, 320.0, 240.0, -0.4],
    };
    assert!(camera.project(DVec3::new(1.5, 0.0, 1.0)).is_none());
    assert!(camera.project(DVec3::new(0.9, 0.0, 1.0)).is_some());
    // The largest radius with a ray is 0.913 (1 - 0.333) = 0.6086.
    assert!(
        camera
            .unproject(DVec2::new(320.0 + 400.0 * 0.61, 240.0))
            .is_none()
    );
    let ray = camera
        .unproject(DVec2::new(320.0 + 400.0 * 0.608, 240.0))
        .unwrap();
    assert!(ray.x < 0.913 && ray.x > 0.85);
}

#[test]
fn a_fisheye_lens_sees_sideways() {
    let camera = Camera {
        id: 1,
        model: CameraModel::Fisheye,
        width: 1000,
        height: 1000,
        params: vec![300.0, 300.0, 500.0, 500.0],
    };
    let pixel = camera.project(DVec3::X).unwrap();
    assert!((pixel.x - 500.0 - 300.0 * std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    assert!((camera.unproject(pixel).unwrap() - DVec3::X).length() < 1e-12);
    let behind = DVec3::new(0.9, 0.1, -0.2).normalize();
    let ray = camera.unproject(camera.project(behind).unwrap()).unwrap();
    assert!((ray - behind).length() < 1e-12);
}

#[test]
fn a_scaled_camera_shows_the_same_view() {
    for camera in cameras() {
        // The second size has other proportions, within what `Scene::open` accepts.
        for (w, h) in [(320, 240), (1281, 955)] {
            let scaled = camera.scaled_to(w, h);
            assert_eq!((scaled.width, scaled.height), (w, h));
            let p = DVec3::new(0.2, -0.3, 1.0);
            let expected =
                camera.project(p).unwrap() * DVec2::new(f64::from(w) / 640.0, f64::from(h) / 480.0);
            let pixel = scaled.project(p).unwrap();
            assert!(
                pixel.distance(expected) < 1e-9,
                "{}: {pixel}, {expected}",
                camera.model
            );
        }
    }
}

#[test]
fn a_camera_with_the_wrong_number_of_parameters_sees_nothing() {
    let camera = Camera {
        id: 1,
        model: CameraModel::OpenCv,
        width: 10,
        height: 10,
        params: vec![1.0, 2.0],
    };
    assert!(camera.project(DVec3::Z).is_none() && camera.unproject(DVec2::ZERO).is_none());
    assert!(camera.focal().0.is_nan() && camera.principal_point().1.is_nan());
    assert_eq!(camera.scaled_to(20, 20).width, 20);
}
