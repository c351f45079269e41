//! Photo files of every kind, and which way up they are.

use crate::sample::{small, write_scene};
use image::{DynamicImage, Rgb, RgbImage};
use io_colmap::{MaskSet, PhotoHeader, Scene, is_picture, read_photo};
use std::fs;
use std::path::Path;

/// Red in its right half, blue in its left.
fn halves(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, _| {
        Rgb(if x >= width / 2 {
            [230, 20, 20]
        } else {
            [20, 20, 230]
        })
    })
}

/// A JPEG whose Exif block has the orientation as its only entry.
fn write_jpeg(path: &Path, picture: &RgbImage, orientation: u8) {
    let mut jpeg = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 95);
    picture.write_with_encoder(encoder).unwrap();
    let mut exif = b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0".to_vec();
    exif.extend(b"\x12\x01\x03\0\x01\0\0\0");
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    jpeg.splice(2..2, exif);
    fs::write(path, jpeg).unwrap();
}

fn is_red(photo: &DynamicImage, x: u32, y: u32) -> bool {
    let [r, _, b] = photo.to_rgb8().get_pixel(x, y).0;
    r > 128 && b < 128
}

#[test]
fn every_usual_kind_of_file_is_read_in_8_bits() {
    let dir = tempfile::tempdir().unwrap();
    let picture = DynamicImage::from(halves(64, 48));
    let wide = DynamicImage::from(picture.to_rgb16());
    // Linear light: half of it is the byte 188.
    let linear = DynamicImage::from(image::Rgb32FImage::from_fn(64, 48, |x, _| {
        Rgb(if x >= 32 {
            [1.0, 0.0, 0.5]
        } else {
            [0.0, 0.5, 1.5]
        })
    }));
    for (name, picture) in [
        ("a.png", &picture),
        ("a.jpg", &picture),
        ("a.webp", &picture),
        ("a.tif", &picture),
        ("b.png", &wide),
        ("b.tiff", &wide),
        ("c.exr", &linear),
    ] {
        let path = dir.path().join(name);
        picture.save(&path).unwrap();
        assert!(is_picture(name));
        let header = PhotoHeader::read(&path).unwrap();
        assert_eq!(
            (header.stored, header.upright()),
            ((64, 48), (64, 48)),
            "{name}"
        );
        assert!(!header.has_alpha, "{name}");
        let photo = read_photo(&path, (64, 48)).unwrap();
        assert!(is_red(&photo, 60, 10) || name == "c.exr", "{name}");
        assert!(!is_red(&photo, 3, 10), "{name}");
        // The content decides, not the name.
        let disguised = dir.path().join("disguised.png");
        fs::copy(&path, &disguised).unwrap();
        assert_eq!(
            PhotoHeader::read(&disguised).unwrap().stored,
            (64, 48),
            "{name}"
        );
    }
    let exr = read_photo(&dir.path().join("c.exr"), (64, 48))
        .unwrap()
        .to_rgb8();
    assert_eq!(exr.get_pixel(40, 3).0, [255, 0, 188]);
    assert_eq!(exr.get_pixel(3, 3).0, [0, 188, 255]);
    for (name, content) in [("a.png", &b"no picture"[..]), ("b.jpg", b"")] {
        let path = dir.path().join(name);
        fs::write(&path, content).unwrap();
        let error = read_photo(&path, (64, 48)).unwrap_err().to_string();
        assert!(error.contains("PNG, JPEG, WebP, TIFF or EXR"), "{error}");
    }
}

#[test]
fn the_colours_of_openexr_are_freed_of_their_alpha_and_others_are_as_they_are() {
    let dir = tempfile::tempdir().unwrap();
    // Linear light: 0.8 of it is the byte 231, 0.4 is 170, 0.2 is 124.
    let pixels = [
        [0.8, 0.4, 0.2, 1.0],
        [0.4, 0.2, 0.1, 0.5],
        [0.0008, 0.0004, 0.0002, 0.001],
        [0.2, 0.4, 0.8, 0.0],
        [0.2, f64::NAN, 0.8, 1.0],
        [0.2, 0.4, 0.8, f64::NAN],
    ];
    let light = image::Rgba32FImage::from_fn(6, 1, |x, _| {
        image::Rgba(pixels[x as usize].map(|v| v as f32))
    });
    let read = |name: &str| {
        let path = dir.path().join(name);
        DynamicImage::from(light.clone()).save(&path).unwrap();
        let photo = read_photo(&path, (6, 1)).unwrap().into_rgba8();
        [0, 1, 2, 3, 4, 5].map(|x| photo.get_pixel(x, 0).0)
    };
    let opaque = [231, 170, 124, 255];
    let glow = [124, 170, 231, 0];
    // No number is black, and clear.
    let black = [124, 0, 231, 255];
    assert_eq!(
        read("a.exr"),
        [opaque, [231, 170, 124, 128], [0; 4], glow, black, glow]
    );
    let [same, half, _, clear, some, none] = read("a.tiff");
    assert_eq!([same, half, clear], [opaque, [170, 124, 89, 128], glow]);
    assert_eq!([some, none], [black, glow]);
}

#[test]
fn photos_are_turned_only_where_their_camera_is() {
    let dir = tempfile::tempdir().unwrap();
    // A camera of 64x48, photos that are stored as 48x64 with a note to turn them.
    let model = small(&["a.jpg", "b.jpg"]);
    write_scene(dir.path(), &small(&[]));
    model.write_binary(&dir.path().join("sparse/0")).unwrap();
    fs::create_dir_all(dir.path().join("images")).unwrap();
    for (name, orientation) in [("a.jpg", 6), ("b.jpg", 8)] {
        write_jpeg(
            &dir.path().join("images").join(name),
            &halves(48, 64),
            orientation,
        );
    }
    let scene = Scene::open(dir.path()).unwrap();
    assert!(
        scene.notes[0].starts_with("2 photos are turned upright"),
        "{:?}",
        scene.notes
    );
    assert_eq!(scene.model, model, "cameras are as they were");
    let photos: Vec<DynamicImage> = scene
        .model
        .views
        .iter()
        .map(|view| scene.read_photo(view).unwrap())
        .collect();
    assert!(
        photos
            .iter()
            .all(|photo| (photo.width(), photo.height()) == (64, 48))
    );
    // Right goes to the bottom when turned clockwise, to the top the other way.
    assert!(is_red(&photos[0], 30, 44) && !is_red(&photos[0], 30, 3));
    assert!(is_red(&photos[1], 30, 3) && !is_red(&photos[1], 30, 44));

    // COLMAP reads pixels as they are stored: such a camera gets them so, and people are told.
    write_jpeg(&dir.path().join("images/a.jpg"), &halves(64, 48), 6);
    write_jpeg(&dir.path().join("images/b.jpg"), &halves(64, 48), 3);
    let scene = Scene::open(dir.path()).unwrap();
    assert_eq!(scene.notes.len(), 1);
    let told = "2 photos have an EXIF orientation that their cameras do not follow";
    assert!(scene.notes[0].starts_with(told), "{:?}", scene.notes);
    for view in &scene.model.views {
        let photo = scene.read_photo(view).unwrap();
        assert!(is_red(&photo, 60, 20) && !is_red(&photo, 3, 20));
    }
    // Turned without a note: nobody knows which way.
    write_jpeg(&dir.path().join("images/a.jpg"), &halves(48, 64), 1);
    let error = Scene::open(dir.path()).unwrap_err().to_string();
    assert!(error.contains("seems to have been turned"), "{error}");
}

#[test]
fn masks_may_be_of_these_kinds_too() {
    let dir = tempfile::tempdir().unwrap();
    write_scene(dir.path(), &small(&["a.png", "b.png"]));
    let masks = dir.path().join("masks");
    fs::create_dir(&masks).unwrap();
    let mask = image::GrayImage::from_fn(64, 48, |x, y| {
        image::Luma([if (20..40).contains(&x) && (10..30).contains(&y) {
            255
        } else {
            0
        }])
    });
    mask.save(masks.join("a.tif")).unwrap();
    DynamicImage::from(mask.clone())
        .to_rgb8()
        .save(masks.join("b.webp"))
        .unwrap();
    let scene = Scene::open(dir.path()).unwrap();
    let set = MaskSet::find(&masks, &scene, None).unwrap();
    for i in 0..2 {
        assert_eq!(set.load(i, 64, 48).unwrap().unwrap(), mask);
    }
    assert!(Scene::has_model(dir.path()) && !Scene::has_model(&masks));
}

/// The checksum of PNG's chunks.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

#[test]
fn a_photo_that_claims_to_be_larger_than_any_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    image::RgbaImage::new(8, 8).save(&path).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    // The header's chunk: its name, width, height and five more bytes, then the checksum.
    for at in [16, 20] {
        bytes[at..at + 4].copy_from_slice(&1_000_000_u32.to_be_bytes());
    }
    let sum = crc(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&sum.to_be_bytes());
    fs::write(&path, bytes).unwrap();
    let size = (1_000_000, 1_000_000);
    assert_eq!(PhotoHeader::read(&path).unwrap().stored, size);
    let error = read_photo(&path, size).unwrap_err().to_string();
    assert!(
        error.contains(
            "a.png: the file says that it is 1000000x1000000, which is larger than any photo; copy"
        ),
        "{error}"
    );
}
