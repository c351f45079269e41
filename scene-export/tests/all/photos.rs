//! Photos beside masks: which are copied, and what becomes of the others.

use crate::rig::{HEIGHT, Rig, WIDTH, listing};
use image::{DynamicImage, GrayImage, ImageFormat, Rgb, RgbImage, Rgba, RgbaImage};
use io_colmap::Scene;
use scene_export::MaskTool;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// Red in its right half, blue in its left.
pub(crate) fn halves(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, _| {
        Rgb(if x >= width / 2 {
            [230, 20, 20]
        } else {
            [20, 20, 230]
        })
    })
}

/// A JPEG that is to be turned by a quarter to the right.
fn turned_jpeg(picture: &RgbImage) -> Vec<u8> {
    let mut jpeg = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 95);
    picture.write_with_encoder(encoder).unwrap();
    let exif =
        b"\xff\xe1\x00\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    jpeg.splice(2..2, exif.iter().copied());
    jpeg
}

/// Writes a photo of the rig's in a format of its own, whatever it is named.
fn put(rig: &Rig, name: &str, picture: &DynamicImage, format: ImageFormat) {
    let path = rig.run().join("scene/images").join(name);
    picture.save_with_format(path, format).unwrap();
}

/// An exported photo is PNG with 8-bit colours and no alpha.
fn read_png(path: &Path) -> RgbImage {
    let reader = image::ImageReader::open(path).unwrap();
    let reader = reader.with_guessed_format().unwrap();
    assert_eq!(reader.format(), Some(ImageFormat::Png));
    match reader.decode().unwrap() {
        DynamicImage::ImageRgb8(photo) => photo,
        other => panic!("{}: {:?}", path.display(), other.color()),
    }
}

fn anew(count: usize) -> String {
    format!("{count} photos are written anew as PNG")
}

#[test]
fn photos_with_alpha_are_written_without_it() {
    let rig = Rig::new();
    let clear = RgbaImage::from_pixel(WIDTH, HEIGHT, Rgba([1, 2, 3, 0]));
    put(&rig, "000.png", &clear.into(), ImageFormat::Png);
    let (out, written) = rig.masks(MaskTool::Nerfstudio);
    assert!(written.notes.contains(&anew(1)), "{:?}", written.notes);
    let photo = read_png(&out.join("images/000.png"));
    assert_eq!(photo.get_pixel(5, 5).0, [1, 2, 3]);
}

#[test]
fn what_a_tool_does_not_read_is_written_anew_whatever_its_name() {
    let rig = Rig::new();
    let picture = DynamicImage::from(halves(WIDTH, HEIGHT));
    let deep = DynamicImage::from(picture.to_rgb16());
    put(&rig, "000.png", &deep, ImageFormat::Tiff);
    put(&rig, "001.JPG", &picture, ImageFormat::WebP);
    put(
        &rig,
        "002.png",
        &picture.to_rgb32f().into(),
        ImageFormat::OpenExr,
    );
    put(&rig, "cam2/b.c.png", &picture, ImageFormat::Jpeg);
    let path = |file: &Value, i: usize| file["frames"][i]["file_path"].as_str().unwrap().to_owned();
    for (tool, webp, count) in [
        (MaskTool::Nerfstudio, "images/001.webp", 2),
        (MaskTool::InstantNgp, "images/001.png", 3),
    ] {
        let (out, written) = rig.masks(tool);
        assert!(written.notes.contains(&anew(count)), "{:?}", written.notes);
        let text = fs::read(out.join("transforms.json")).unwrap();
        let file: Value = serde_json::from_slice(&text).unwrap();
        let names: Vec<String> = (0..4).map(|i| path(&file, i)).collect();
        let wanted = [
            "images/000.png",
            webp,
            "images/002.png",
            "images/cam2/b.c.jpg",
        ];
        assert_eq!(names, wanted);
        for name in names {
            let photo = out.join(&name);
            let reader = image::ImageReader::open(&photo).unwrap();
            let by_name = reader.format();
            let by_content = reader.with_guessed_format().unwrap().format();
            assert_eq!(by_name, by_content, "{name}");
        }
        assert_eq!(read_png(&out.join("images/000.png")), halves(WIDTH, HEIGHT));
        fs::remove_dir_all(rig.out()).unwrap();
    }
    // The model has the names that files have.
    let (out, _) = rig.masks(MaskTool::Brush);
    let scene = Scene::open(&out).unwrap();
    let names: Vec<&str> = scene.model.views.iter().map(|view| &*view.name).collect();
    assert_eq!(names, ["000.png", "001.webp", "002.png", "cam2/b.c.jpg"]);
}

#[test]
fn photos_that_their_cameras_see_upright_are_turned() {
    let rig = Rig::new();
    // Stored on its side.
    let jpeg = turned_jpeg(&halves(HEIGHT, WIDTH));
    fs::write(rig.run().join("scene/images/001.JPG"), &jpeg).unwrap();
    let (out, written) = rig.masks(MaskTool::Nerfstudio);
    assert!(written.notes.contains(&anew(1)), "{:?}", written.notes);
    let files = listing(&out);
    assert!(!files.contains(&"images/001.JPG".to_owned()), "{files:?}");
    let photo = read_png(&out.join("images/001.png"));
    assert_eq!(photo.dimensions(), (WIDTH, HEIGHT));
    // What was right is below.
    for (y, is_red) in [(3, false), (HEIGHT - 3, true)] {
        let [r, _, b] = photo.get_pixel(WIDTH / 2, y).0;
        assert_eq!(r > b, is_red, "{y}: {r} {b}");
    }
}

#[test]
fn grey_photos_become_colours_where_a_tool_needs_them() {
    let rig = crate::spin_nerf::flat_rig();
    let grey = GrayImage::from_pixel(WIDTH, HEIGHT, image::Luma([90]));
    put(&rig, "000.png", &grey.into(), ImageFormat::Png);
    let (out, _) = rig.masks(MaskTool::SpinNerf);
    for folder in ["images", "images_1"] {
        let photo = read_png(&out.join(folder).join("000.png"));
        assert_eq!(photo.get_pixel(1, 1).0, [90; 3]);
    }
}
