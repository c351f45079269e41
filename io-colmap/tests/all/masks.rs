//! Masks on disk: names, polarity, pixel formats, sizes.

use crate::sample::{small, write_scene};
use image::{DynamicImage, GrayImage, ImageBuffer, Luma, Rgb, RgbImage, Rgba};
use io_colmap::{MaskSet, Polarity, Scene};
use std::path::Path;

const PHOTOS: [&str; 4] = ["p0.png", "p1.png", "p2.png", "p3.png"];

fn scene(dir: &Path) -> Scene {
    write_scene(dir, &small(&PHOTOS));
    Scene::open(dir).unwrap()
}

/// A disc in the middle: `inside` on `outside`.
fn disc(w: u32, h: u32, inside: u8, outside: u8) -> GrayImage {
    GrayImage::from_fn(w, h, |x, y| {
        let (dx, dy) = (
            f64::from(x) - f64::from(w) / 2.0,
            f64::from(y) - f64::from(h) / 2.0,
        );
        Luma([if dx.hypot(dy) < f64::from(h) * 0.3 {
            inside
        } else {
            outside
        }])
    })
}

fn save(dir: &Path, name: &str, image: impl Into<DynamicImage>) {
    std::fs::create_dir_all(dir).unwrap();
    image.into().save(dir.join(name)).unwrap();
}

#[test]
fn names_are_matched_and_missing_ones_counted() {
    for (first, second) in [
        ("p0.png", "p2.png"),
        ("p0.png.png", "p2.png.png"),
        ("p0_mask.png", "p2_mask.png"),
        ("mask_p0.png", "mask_p2.png"),
        ("p0.mask.png", "p2.mask.png"),
        ("dynamic_mask_p0.png", "dynamic_mask_p2.png"),
        ("p0.jpg", "p2.jpeg"),
        ("0000.png", "0002.png"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let scene = scene(dir.path());
        let masks = dir.path().join("masks");
        save(&masks, first, disc(64, 48, 255, 0));
        save(&masks, second, disc(64, 48, 255, 0));
        let set = MaskSet::find(&masks, &scene, None).unwrap();
        assert_eq!(set.paths[0], Some(masks.join(first)));
        assert_eq!(set.paths[2], Some(masks.join(second)));
        assert_eq!(set.missing, ["p1.png", "p3.png"]);
        assert!(set.load(1, 64, 48).unwrap().is_none() && set.load(99, 64, 48).unwrap().is_none());
        let summary = set.summary();
        assert!(
            summary.starts_with("2 of 4 photos have a mask ("),
            "{summary}"
        );
        assert!(
            summary.contains("2 have none (p1.png, p3.png); white = object"),
            "{summary}"
        );
    }
}

#[test]
fn masks_beside_the_photos_and_in_sorted_order() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    save(&scene.image_dir, "p1_mask.png", disc(64, 48, 255, 0));
    let set = MaskSet::find(&scene.image_dir, &scene, None).unwrap();
    assert_eq!(set.missing, ["p0.png", "p2.png", "p3.png"]);

    let masks = dir.path().join("other");
    for name in ["w.png", "x.png", "y.png", "z.png"] {
        save(&masks, name, disc(64, 48, 255, 0));
    }
    std::fs::remove_file(scene.image_dir.join("p1_mask.png")).unwrap();
    let set = MaskSet::find(&masks, &scene, None).unwrap();
    assert_eq!(set.paths[3], Some(masks.join("z.png")));
    assert!(
        set.notes.iter().any(|n| n.contains("sorted order")),
        "{:?}",
        set.notes
    );

    std::fs::remove_file(masks.join("z.png")).unwrap();
    let error = MaskSet::find(&masks, &scene, None).unwrap_err().to_string();
    assert!(
        error.contains("none of the 3 masks (such as \"w.png\")"),
        "{error}"
    );
    assert!(error.contains("; name each mask like its photo"), "{error}");
}

#[test]
fn a_second_mask_of_a_photo_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let masks = dir.path().join("masks");
    for name in ["p0.png", "p1.png", "p1_mask.png"] {
        save(&masks, name, disc(64, 48, 255, 0));
    }
    let set = MaskSet::find(&masks, &scene, None).unwrap();
    let says = "such as p1_mask.png, belong to no registered photo, or to one that has a mask";
    assert!(
        set.notes.iter().any(|note| note.contains(says)),
        "{:?}",
        set.notes
    );
}

#[cfg(unix)]
#[test]
fn a_closed_sub_folder_costs_no_mask_in_others() {
    use std::fs::{self, Permissions};
    use std::os::unix::fs::PermissionsExt as _;
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let masks = dir.path().join("masks");
    let closed = [&masks, &scene.image_dir].map(|folder| folder.join("lost+found"));
    for folder in &closed {
        fs::create_dir_all(folder).unwrap();
        fs::set_permissions(folder, Permissions::from_mode(0o000)).unwrap();
    }
    if fs::read_dir(&closed[0]).is_ok() {
        eprintln!("skipped: this user may read every folder");
        return;
    }
    let error = MaskSet::find(&masks, &scene, None).unwrap_err().to_string();
    assert!(
        error.contains("holds no masks") && error.contains("lost+found cannot be read"),
        "{error}"
    );
    // As many as photos, but nobody knows whether that is all.
    let others = ["w.png", "x.png", "y.png", "z.png"];
    for name in others {
        save(&masks, name, disc(64, 48, 255, 0));
    }
    let error = MaskSet::find(&masks, &scene, None).unwrap_err().to_string();
    assert!(
        error.contains("none of the 4 masks")
            && error.contains("their order is not known: the sub-folder ")
            && error.contains("masks/lost+found cannot be read")
            && error.contains("; make all of them readable, or name each mask like its photo"),
        "{error}"
    );
    for name in others {
        fs::remove_file(masks.join(name)).unwrap();
    }
    save(&masks, "p0.png", disc(64, 48, 255, 0));
    let set = MaskSet::find(&masks, &scene, None).unwrap();
    assert_eq!(set.paths[0], Some(masks.join("p0.png")));
    let named = |note: &&String| note.contains("lost+found cannot be read and is left out");
    assert_eq!(set.notes.iter().filter(named).count(), 1, "{:?}", set.notes);
    for folder in &closed {
        fs::set_permissions(folder, Permissions::from_mode(0o700)).unwrap();
    }
}

#[test]
fn polarity_is_found_jointly_and_can_be_stated() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let masks = dir.path().join("masks");
    // Black is the object; one mask is wrong and one empty, which must not tip the balance.
    save(&masks, "p0.png", disc(64, 48, 0, 255));
    save(&masks, "p1.png", disc(64, 48, 0, 255));
    save(&masks, "p2.png", disc(64, 48, 255, 0));
    save(&masks, "p3.png", disc(64, 48, 0, 0));
    let set = MaskSet::find(&masks, &scene, None).unwrap();
    assert_eq!(set.polarity, Polarity::BlackIsObject);
    assert!(
        set.summary().contains("black = object: on average"),
        "{}",
        set.summary()
    );
    assert!(
        set.summary()
            .contains("2 of 3 masks agree; this is not certain"),
        "{}",
        set.summary()
    );
    let mask = set.load(0, 64, 48).unwrap().unwrap();
    assert_eq!(
        (mask.get_pixel(32, 24).0, mask.get_pixel(0, 0).0),
        ([255], [0])
    );

    let set = MaskSet::find(&masks, &scene, Some(Polarity::WhiteIsObject)).unwrap();
    assert_eq!(
        set.load(0, 64, 48).unwrap().unwrap().get_pixel(32, 24).0,
        [0]
    );
    assert!(
        set.summary().contains("white = object as stated, though"),
        "{}",
        set.summary()
    );
}

#[test]
fn every_pixel_format_gives_the_same_mask() {
    let grey = disc(64, 48, 255, 0);
    let expected = [255, 0];
    let wide = image::ImageBuffer::from_fn(64, 48, |x, y| {
        Luma([u16::from(grey.get_pixel(x, y).0[0]) * 257])
    });
    let wide_small =
        image::ImageBuffer::from_fn(64, 48, |x, y| Luma([u16::from(grey.get_pixel(x, y).0[0])]));
    let cut_out =
        image::RgbaImage::from_fn(64, 48, |x, y| Rgba([40, 50, 60, grey.get_pixel(x, y).0[0]]));
    let opaque = DynamicImage::from(grey.clone()).to_rgba8();
    for image in [
        DynamicImage::from(grey.clone()),
        DynamicImage::from(grey.clone()).to_rgb8().into(),
        opaque.into(),
        cut_out.into(),
        DynamicImage::ImageLuma16(wide),
        DynamicImage::ImageLuma16(wide_small),
        DynamicImage::from(disc(64, 48, 1, 0)),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let scene = scene(dir.path());
        let masks = dir.path().join("masks");
        let colour = image.color();
        save(&masks, "p0.png", image);
        let set = MaskSet::find(&masks, &scene, None).unwrap();
        let mask = set.load(0, 64, 48).unwrap().unwrap();
        let found = [mask.get_pixel(32, 24).0[0], mask.get_pixel(2, 2).0[0]];
        assert_eq!(found, expected, "{colour:?} {:?}", set.notes);
    }
}

#[test]
fn sizes_must_fit() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let masks = dir.path().join("masks");
    save(&masks, "p0.png", disc(128, 96, 255, 0));
    let set = MaskSet::find(&masks, &scene, None).unwrap();
    assert!(
        set.notes
            .iter()
            .any(|n| n.contains("1 masks have another size")),
        "{:?}",
        set.notes
    );
    assert_eq!(set.load(0, 64, 48).unwrap().unwrap().dimensions(), (64, 48));
    let error = set.load(0, 64, 64).unwrap_err().to_string();
    assert!(error.contains("is 128x96 but 64x64 is needed"), "{error}");

    save(&masks, "p1.png", disc(64, 64, 255, 0));
    let error = MaskSet::find(&masks, &scene, None).unwrap_err().to_string();
    assert!(
        error.contains("p1.png: the mask is 64x64 but its photo"),
        "{error}"
    );
    assert!(
        error.contains("its photo p1.png is 64x48, another shape; make the mask"),
        "{error}"
    );

    save(&masks, "p1.png", disc(48, 64, 255, 0));
    let error = MaskSet::find(&masks, &scene, None).unwrap_err().to_string();
    assert!(
        error.contains("is 64x48, another shape; turn the mask"),
        "{error}"
    );
}

#[test]
fn masks_without_an_object_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let masks = dir.path().join("masks");
    let find = |polarity| {
        MaskSet::find(&masks, &scene, polarity)
            .unwrap_err()
            .to_string()
    };
    assert!(find(None).contains("cannot list"));
    std::fs::create_dir(&masks).unwrap();
    assert!(find(None).contains("holds no masks (PNG, JPEG, WebP or TIFF files); give the folder"));
    for (value, says) in [(0, "all black"), (255, "all white")] {
        save(&masks, "p0.png", disc(64, 48, value, value));
        save(&masks, "p1.png", disc(64, 48, value, value));
        assert!(find(None).contains(&format!("the 2 masks found are {says}, so none shows")));
        assert!(find(Some(Polarity::BlackIsObject)).contains(says));
    }
    std::fs::write(masks.join("p2.png"), b"no picture").unwrap();
    let error = find(None);
    assert!(
        error.contains("p2.png: the mask cannot be decoded"),
        "{error}"
    );
}

/// As no mask looks, at the size of the photos.
fn colours() -> RgbImage {
    RgbImage::from_fn(64, 48, |x, y| {
        Rgb([(4 * x) as u8, (5 * y) as u8, (x * y % 251) as u8])
    })
}

#[test]
fn photos_are_not_taken_for_masks() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let folder = dir.path().join("images_4");
    for name in ["p0.png", "p1.png"] {
        save(&folder, name, colours());
    }
    save(&folder, "p2.png", disc(64, 48, 255, 0));
    let error = MaskSet::find(&folder, &scene, None)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("images_4: 2 of the 3 masks looked at are in many colours, such as ")
            && error.contains("p0.png, so they look like photos; name the folder")
            && error.contains("--masks"),
        "{error}"
    );
    let error = MaskSet::find_ignored(&folder, &scene)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("3 ignore pictures") && error.contains("--ignore"),
        "{error}"
    );
    // One that strayed among masks is left to the checks of masks.
    save(&folder, "p1.png", disc(64, 48, 255, 0));
    assert!(MaskSet::find(&folder, &scene, None).is_ok());
    // A photo that is cut out is a mask by its alpha.
    let cut_out = image::RgbaImage::from_fn(64, 48, |x, y| {
        let [r, g, b] = colours().get_pixel(x, y).0;
        Rgba([r, g, b, if x < 20 { 255 } else { 0 }])
    });
    for name in ["p0.png", "p1.png", "p2.png"] {
        save(&folder, name, cut_out.clone());
    }
    assert!(MaskSet::find(&folder, &scene, None).is_ok());
}

#[test]
fn a_cut_out_out_of_view_is_empty_and_one_that_fills_its_photo_is_white() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let masks = dir.path().join("masks");
    let cut_out = |is_object: fn(u32) -> bool| {
        image::RgbaImage::from_fn(64, 48, |x, y| {
            let [r, g, b] = colours().get_pixel(x, y).0;
            Rgba([r, g, b, if is_object(x) { 255 } else { 0 }])
        })
    };
    save(&masks, "p0.png", cut_out(|x| (20..40).contains(&x)));
    save(&masks, "p1.png", cut_out(|_| false));
    save(&masks, "p2.png", cut_out(|_| true));
    // A mask among them keeps its brightness, also one with a channel too many.
    save(
        &masks,
        "p3.png",
        DynamicImage::from(disc(64, 48, 255, 0)).into_rgba8(),
    );
    let set = MaskSet::find(&masks, &scene, Some(Polarity::WhiteIsObject)).unwrap();
    let share = |i: usize| {
        let mask = set.load(i, 64, 48).unwrap().unwrap();
        let sum: f64 = mask.iter().map(|value| f64::from(*value)).sum();
        sum / f64::from(255 * 64 * 48)
    };
    assert_eq!([0, 1, 2].map(share), [20.0 / 64.0, 0.0, 1.0]);
    assert!(share(3) > 0.1 && share(3) < 0.3);
}

#[test]
fn masks_drawn_in_one_colour_are_read_by_their_brightness() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let masks = dir.path().join("masks");
    let draw = |colour: [u8; 3]| {
        let disc = disc(64, 48, 255, 0);
        for name in PHOTOS {
            let drawn = RgbImage::from_fn(64, 48, |x, y| {
                Rgb(colour.map(|channel| channel.min(disc.get_pixel(x, y).0[0])))
            });
            save(&masks, name, drawn);
        }
        MaskSet::find(&masks, &scene, None)
    };
    let mask = draw([0, 255, 0]).unwrap().load(0, 64, 48).unwrap().unwrap();
    assert!(mask.get_pixel(32, 24).0[0] > 127 && mask.get_pixel(2, 2).0[0] == 0);
    // Red is dark.
    let error = draw([255, 0, 0]).unwrap_err().to_string();
    assert!(
        error.contains("brighter than 54 of 255") && error.contains("--label"),
        "{error}"
    );
}

#[test]
fn labels_of_16_bits_are_the_same_numbers_in_all_files() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let masks = dir.path().join("masks");
    let write = |name: &str, inside: u16, outside: u16| {
        let disc = disc(64, 48, 1, 0);
        let wide = ImageBuffer::from_fn(64, 48, |x, y| {
            Luma([match disc.get_pixel(x, y).0 {
                [1] => inside,
                _ => outside,
            }])
        });
        save(&masks, name, DynamicImage::ImageLuma16(wide));
    };
    let refused = |says: &str| {
        let error = MaskSet::find(&masks, &scene, None).unwrap_err().to_string();
        assert!(error.contains(says) && error.contains("--label"), "{error}");
    };
    // Whether 1 is the object, a frame with a 2 in it makes doubtful for all.
    write("p0.png", 1, 0);
    write("p1.png", 2, 0);
    refused("of the 2 masks is brighter than 2 of 255");
    write("p0.png", 3, 3);
    write("p1.png", 3, 3);
    refused("of the 2 masks is brighter than 3 of 255");
    write("p0.png", 257, 0);
    write("p1.png", 300, 0);
    refused("of the 2 masks is brighter than 1 of 255");
    // In a matte that uses all of its depth, as much is next to nothing.
    write("p0.png", 200, 0);
    write("p1.png", 65535, 0);
    let set = MaskSet::find(&masks, &scene, None).unwrap();
    let middle = |i| {
        let mask = set.load(i, 64, 48).unwrap().unwrap();
        mask.get_pixel(32, 24).0[0]
    };
    assert_eq!([middle(0), middle(1)], [1, 255]);
}

#[test]
fn nothing_may_be_ignored_and_anything_but_black_is() {
    let dir = tempfile::tempdir().unwrap();
    let scene = scene(dir.path());
    let ignore = dir.path().join("ignore");
    let find = || MaskSet::find_ignored(&ignore, &scene);
    save(&ignore, "p0.png", disc(64, 48, 0, 0));
    let set = find().unwrap();
    assert!(
        set.summary()
            .starts_with("1 of 4 photos have an ignore picture (")
            && set.summary().ends_with("; what is not black is ignored"),
        "{}",
        set.summary()
    );
    let black = set.load(0, 64, 48).unwrap().unwrap();
    assert!(black.iter().all(|value| *value == 0));

    // Grey counts, and so does what lies along the border.
    save(&ignore, "p1.png", disc(64, 48, 0, 100));
    let set = find().unwrap();
    let grey = set.load(1, 64, 48).unwrap().unwrap();
    assert_eq!(
        [grey.get_pixel(2, 2).0, grey.get_pixel(32, 24).0],
        [[100], [0]]
    );

    save(&ignore, "p2.png", disc(48, 48, 255, 0));
    let error = find().unwrap_err().to_string();
    assert!(
        error.contains("the ignore picture is 48x48 but its photo p2.png")
            && error.contains("; make the ignore picture from the photo"),
        "{error}"
    );
}
