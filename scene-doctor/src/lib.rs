//! Looks at a posed photo set before anyone trains on it, and says what is wrong and what to do.
//!
//! Most trainings that fail do so for reasons that were there to be seen: photos from one spot, a
//! third of them blurred, masks of the wrong polarity, a box around nothing. Each check is one file
//! here and comes back as a [`Finding`]: pass, warn or fail, a sentence with numbers, a remedy.
//!
//! 1. An [`Exam`] holds what is looked at: views with photos and masks, sparse points, where the
//!    object is ([`Subject`]) and what it stands on ([`Ground`]). Whoever trains knows the latter two and
//!    hands them in, so that what is checked is what will be trained on.
//! 2. [`examine`] makes all checks; the [`Report`] prints itself as a table and serialises to JSON.
//! 3. [`page`] makes one HTML file of it, with the scene to be turned with the mouse.
//!
//! Angles are in degrees, lengths in the scene's own unit, colours 8-bit sRGB, white in masks is the
//! object.
//!
//! ```
//! use glam::{DQuat, DVec3};
//! use io_colmap::{Camera, CameraModel, Pose};
//! use scene_doctor::{Exam, ExamView, Files, Masks, Status, Subject, examine};
//!
//! let camera = Camera {
//!     id: 1, model: CameraModel::Pinhole, width: 64, height: 48, params: vec![60.0, 60.0, 32.0, 24.0],
//! };
//! let photo = image::RgbImage::from_fn(64, 48, |x, y| image::Rgb([(x * y % 251) as u8; 3]));
//! // Twenty cameras that turn on the spot.
//! let views = (0..20).map(|i| ExamView {
//!     name: "photo.jpg",
//!     id: i,
//!     camera: &camera,
//!     camera_from_world: Pose {
//!         rotation: DQuat::from_rotation_y(0.05 * f64::from(i)),
//!         translation: DVec3::ZERO,
//!     },
//!     photo: &photo,
//!     mask: None,
//! });
//! let subject = Subject::Unknown { why: "the cameras' axes do not meet".into() };
//! let exam = Exam::new(views.collect(), &[], subject, None);
//!
//! let report = examine("photos/cat", &exam, &Files::default(), &Masks::None { offered: None });
//! assert_eq!(report.verdict, Status::Fail);
//! let parallax = report.checks.iter().find(|finding| finding.check == "parallax").unwrap();
//! assert!(parallax.says.contains("hardly moved"));
//! ```
//!
//! # Map
//! | module | idea |
//! |---|---|
//! | `scene`, `photo` | what is examined; what is measured of a photo |
//! | `cameras`, `directions`, `parallax`, `outliers`, `masks`, `subject`, `cost` | the checks |
//! | `finding`, `table` | a check's outcome, all of them; the table |
//! | `drawing`, `page` | the scene as the page draws it; the page |

mod cameras;
mod cost;
mod directions;
mod drawing;
mod finding;
mod masks;
mod outliers;
mod page;
mod parallax;
mod photo;
mod scene;
mod subject;
mod table;

pub use cameras::{Files, Missing, photos_without_pose};
pub use cost::{Cost, cost};
pub use drawing::Drawing;
pub use finding::{Finding, Report, Status};
pub use masks::{Consensus, Masks};
pub use page::page;
pub use scene::{Exam, ExamView, Ground, ObjectMask, Subject};

/// Makes all checks of a scene; `name` is what its user calls it.
#[must_use]
pub fn examine(name: &str, exam: &Exam, files: &Files, masks: &Masks) -> Report {
    let checks = [
        Some(cameras::cameras(exam)),
        Some(cameras::files(exam.views.len(), files)),
        Some(subject::object(exam)),
        directions::coverage(exam),
        Some(parallax::parallax(exam)),
        Some(outliers::sharpness(exam)),
        Some(outliers::exposure(exam)),
        Some(masks::masks(exam, masks)),
        masks::agreement(exam, masks),
        subject::ground(exam),
    ];
    Report::new(name, checks.into_iter().flatten().collect())
}
