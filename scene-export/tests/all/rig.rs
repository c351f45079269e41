//! A run as `sos train` leaves it, small: four cameras around an octahedron, of which the third does
//! not see it.

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, SmallVec,
    WritableImage as _,
};
use glam::{DMat3, DQuat, DVec3};
use image::{ImageBuffer, Luma, Rgb, RgbImage, Rgba, RgbaImage};
use io_colmap::{Camera, CameraModel, Model, Pose, SparsePoint, View};
use scene_export::{ExportError, MaskTool, Options, Product, Target, Written, export};
use std::fs;
use std::path::{Path, PathBuf};

pub(crate) const WIDTH: u32 = 40;
pub(crate) const HEIGHT: u32 = 30;
pub(crate) const FOCAL: f64 = 50.0;

/// Names of the photos, with a folder, two dots, and endings of both cases.
pub(crate) const PHOTOS: [&str; 4] = ["000.png", "001.JPG", "002.png", "cam2/b.c.png"];

/// The pixel values that the object's matte is made of: all kinds of soft.
pub(crate) fn alpha(photo: usize, x: u32, y: u32) -> u16 {
    if photo == 2 {
        return 0;
    }
    let (dx, dy) = (f64::from(x) - 20.0, f64::from(y) - 15.0);
    let inside = 8.0 - (dx * dx + dy * dy).sqrt();
    ((inside / 4.0 + 0.5).clamp(0.0, 1.0) * 65535.0) as u16
}

pub(crate) fn object_colour(x: u32, y: u32) -> [u8; 3] {
    [(x * 6) as u8, 200, (y * 8) as u8]
}

pub(crate) fn plate_colour(x: u32) -> [u8; 3] {
    [30, (x * 5) as u8, 128]
}

pub(crate) fn depth(photo: usize, x: u32, y: u32) -> f32 {
    if alpha(photo, x, y) > 3000 {
        3.0 + x as f32 / 100.0
    } else {
        0.0
    }
}

/// A run in a folder of its own, which goes with it.
pub(crate) struct Rig {
    dir: tempfile::TempDir,
}

impl Rig {
    pub(crate) fn new() -> Self {
        let rig = Self {
            dir: tempfile::tempdir().unwrap(),
        };
        let run = rig.run();
        for (photo, name) in PHOTOS.iter().enumerate() {
            write_view(&run, photo, name);
            let photo = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| Rgb([x as u8, y as u8, 77]));
            save(&run.join("scene/images").join(name), |path| {
                photo.save(path)
            });
        }
        model().write_binary(&run.join("scene/sparse/0")).unwrap();
        fs::write(run.join("mesh.ply"), PLY).unwrap();
        fs::write(
            run.join("config.toml"),
            "preset = \"quick\"\n[input]\nscene = \"/nowhere/scene\"\nout = \"/nowhere\"\ndemo = true\n",
        )
        .unwrap();
        rig
    }

    pub(crate) fn run(&self) -> PathBuf {
        self.dir.path().join("run")
    }

    pub(crate) fn out(&self) -> PathBuf {
        self.dir.path().join("out")
    }

    pub(crate) fn export(&self, product: Product) -> Result<Written, ExportError> {
        export(&self.run(), product, &self.out(), &Options::default())
    }

    /// Exports, and gives the folder with what was noted.
    pub(crate) fn files(&self, target: Target) -> (PathBuf, Written) {
        let written = self.export(Product::Files(target)).unwrap();
        (self.out(), written)
    }

    pub(crate) fn masks(&self, tool: MaskTool) -> (PathBuf, Written) {
        let written = self.export(Product::Masks(tool)).unwrap();
        (self.out(), written)
    }

    /// The error of an export, which is one line, names nothing that is gone, and leaves nothing behind.
    pub(crate) fn complaint(&self, product: Product) -> String {
        let error: ExportError = self.export(product).unwrap_err();
        let text = error.to_string();
        assert!(!text.contains('\n'), "{text}");
        assert!(!text.contains(".sos-partial"), "{text}");
        assert!(!self.out().exists());
        text
    }

    /// Gives a photo another name, wherever it has one.
    pub(crate) fn rename(&self, old: &str, new: &str) {
        let run = self.run();
        let mut pairs = vec![(format!("scene/images/{old}"), format!("scene/images/{new}"))];
        for folder in ["alpha", "foreground", "background", "normal"] {
            let file = |name| format!("{folder}/{}.png", key(name));
            pairs.push((file(old), file(new)));
        }
        for (old, new) in pairs {
            let new = run.join(new);
            fs::create_dir_all(new.parent().unwrap()).unwrap();
            fs::rename(run.join(old), new).unwrap();
        }
        self.remodel(|model| {
            let view = model.views.iter_mut().find(|view| view.name == old);
            view.unwrap().name = new.to_owned();
        });
    }

    /// Changes the scene's cameras.
    pub(crate) fn remodel(&self, change: impl Fn(&mut Model)) {
        let dir = self.run().join("scene/sparse/0");
        let mut model = Model::read(&dir).unwrap();
        change(&mut model);
        model.write_binary(&dir).unwrap();
    }
}

/// All files below a folder, relative, sorted.
pub(crate) fn listing(folder: &Path) -> Vec<String> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let inside = path.strip_prefix(folder).unwrap();
                files.push(inside.to_string_lossy().replace('\\', "/"));
            }
        }
    }
    files.sort();
    files
}

/// The key of a photo in the run.
pub(crate) fn key(photo: &str) -> &str {
    photo.rsplit_once('.').unwrap().0
}

pub(crate) fn model() -> Model {
    let mut model = Model::default();
    let camera = Camera {
        id: 1,
        model: CameraModel::Pinhole,
        width: WIDTH,
        height: HEIGHT,
        params: vec![FOCAL, FOCAL + 1.0, 20.5, 15.5],
    };
    model.cameras.insert(1, camera);
    for (i, name) in PHOTOS.iter().enumerate() {
        // Around the y axis, looking at the origin from a distance of 4; the third looks away.
        let turn = if i == 2 { std::f64::consts::PI } else { 0.0 };
        let rotation = DQuat::from_rotation_y(turn) * DQuat::from_rotation_y(0.4 * i as f64);
        let centre = DQuat::from_rotation_y(0.4 * i as f64).inverse() * DVec3::new(0.0, 0.0, -4.0);
        model.views.push(View {
            id: i as u32 + 1,
            name: (*name).to_owned(),
            camera_id: 1,
            camera_from_world: Pose {
                rotation,
                translation: -(rotation * centre),
            },
        });
    }
    let point = |id, position, views: &[u32]| SparsePoint {
        id,
        position,
        colour: [9, 8, 7],
        error: 0.5,
        views: views.to_vec(),
    };
    model.points = vec![
        // In the middle of the object, with and without a track.
        point(1, DVec3::new(0.01, 0.0, 0.0), &[1, 2]),
        point(2, DVec3::new(0.0, 0.05, 0.0), &[]),
        // Beside it everywhere.
        point(3, DVec3::new(0.0, 0.95, 0.0), &[1, 2, 4]),
    ];
    model
}

fn write_view(run: &Path, photo: usize, name: &str) {
    let file =
        |folder: &str, ending: &str| run.join(folder).join(format!("{}.{ending}", key(name)));
    let matte = ImageBuffer::<Luma<u16>, Vec<u16>>::from_fn(WIDTH, HEIGHT, |x, y| {
        Luma([alpha(photo, x, y)])
    });
    save(&file("alpha", "png"), |path| matte.save(path));
    let cutout = RgbaImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let [r, g, b] = object_colour(x, y);
        Rgba([
            r,
            g,
            b,
            (f32::from(alpha(photo, x, y)) / 257.0).round() as u8,
        ])
    });
    save(&file("foreground", "png"), |path| cutout.save(path));
    let plate = RgbImage::from_fn(WIDTH, HEIGHT, |x, _| Rgb(plate_colour(x)));
    save(&file("background", "png"), |path| plate.save(path));
    let normal = RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        Rgb(if depth(photo, x, y) > 0.0 {
            [128, 128, 0]
        } else {
            [0; 3]
        })
    });
    save(&file("normal", "png"), |path| normal.save(path));

    let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    let values: Vec<f32> = pixels.map(|(x, y)| depth(photo, x, y)).collect();
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> =
        [AnyChannel::new("Z", FlatSamples::F32(values))]
            .into_iter()
            .collect();
    let layer = Layer::new(
        (WIDTH as usize, HEIGHT as usize),
        LayerAttributes::named("depth"),
        Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels),
    );
    save(&file("depth", "exr"), |path| {
        Image::from_layer(layer)
            .write()
            .non_parallel()
            .to_file(path)
    });
}

pub(crate) fn save<E: std::fmt::Debug>(path: &Path, write: impl FnOnce(&Path) -> Result<(), E>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    write(path).unwrap();
}

/// The corners of the octahedron, in the order of the file.
pub(crate) fn corners() -> [DVec3; 6] {
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| 0.5 * axis);
    [x, -x, y, -y, z, -z]
}

/// World axes of a camera: right, down, forward.
pub(crate) fn axes(pose: &Pose) -> DMat3 {
    DMat3::from_quat(pose.inverse().rotation)
}

pub(crate) const PLY: &str = "\
ply
format ascii 1.0
element vertex 6
property float x
property float y
property float z
property float nx
property float ny
property float nz
property uchar red
property uchar green
property uchar blue
element face 8
property list uchar int vertex_indices
end_header
0.5 0 0 1 0 0 255 0 0
-0.5 0 0 -1 0 0 0 255 0
0 0.5 0 0 1 0 0 0 255
0 -0.5 0 0 -1 0 128 128 128
0 0 0.5 0 0 1 10 10 10
0 0 -0.5 0 0 -2 255 255 255
3 0 2 4
3 2 1 4
3 1 3 4
3 3 0 4
3 2 0 5
3 1 2 5
3 3 1 5
3 0 3 5
";
