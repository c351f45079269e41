//! What a folder's pictures are for, and what messages call them.

use crate::scene::same_shape;

/// What the pictures of a folder say about their photos.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MaskKind {
    /// Where the object is.
    Masks,
    /// What is not to be looked at: nothing at all in a photo that nobody walks through.
    Ignored,
}

impl MaskKind {
    pub(crate) fn one(self) -> &'static str {
        match self {
            MaskKind::Masks => "mask",
            MaskKind::Ignored => "ignore picture",
        }
    }

    pub(crate) fn many(self) -> &'static str {
        match self {
            MaskKind::Masks => "masks",
            MaskKind::Ignored => "ignore pictures",
        }
    }

    /// One of them, with its article.
    pub(crate) fn any(self) -> &'static str {
        match self {
            MaskKind::Masks => "a mask",
            MaskKind::Ignored => "an ignore picture",
        }
    }

    /// What to do where the folder is that of the photos.
    pub(crate) fn remedy_for_photos(self) -> &'static str {
        match self {
            MaskKind::Masks => {
                "name the folder that the masks lie in with --masks; they are black and white, or cut-outs with alpha"
            }
            MaskKind::Ignored => {
                "name the folder that the ignore pictures lie in with --ignore; they are black where a photo is to be looked at"
            }
        }
    }

    /// What to do about one of another shape than its photo.
    pub(crate) fn remedy_for_shape(self, (width, height): (u32, u32), photo: (u32, u32)) -> String {
        let one = self.one();
        if same_shape((height, width), photo) {
            format!(
                "turn the {one}, which lies on its side beside its photo: one of the two was not turned as the photo's EXIF says"
            )
        } else {
            format!("make the {one} from the photo itself, without cropping")
        }
    }
}
