//! Conversion of SVG source to the stored files: an SVG with text as outlines, and a PNG. Only embedded fonts are used.

use super::canvas::Type;
use resvg::{tiny_skia, usvg};
use std::sync::{Arc, LazyLock};

/// Pixels of the PNG per px of the SVG. 2 makes the PNG sharp on dense screens and in print.
pub const PNG_SCALE: u32 = 2;

/// Finished picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    source: String,
    width: u32,
    height: u32,
}

/// Error of a picture that could not be converted.
#[derive(Debug, thiserror::Error)]
pub enum DrawError {
    /// The source is not valid SVG: a bug of the drawing code.
    #[error("the picture is not valid SVG (a bug of the drawing code): {0}")]
    Svg(#[from] usvg::Error),
    /// There is not enough memory for the pixels.
    #[error("a picture of {width} × {height} pixels is too large to draw")]
    TooLarge {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// The PNG encoder failed.
    #[error("the picture can't be encoded as PNG: {0}")]
    Png(#[source] Box<dyn std::error::Error + Send + Sync>),
}

impl Picture {
    pub(super) fn new(source: String, width: u32, height: u32) -> Self {
        Self { source, width, height }
    }

    /// Returns width and height, px.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Returns the SVG. All text is converted to outlines, so that it looks the same in every viewer.
    pub fn svg(&self) -> String {
        let options = usvg::WriteOptions {
            coordinates_precision: 3,
            transforms_precision: 6,
            indent: usvg::Indent::None,
            ..Default::default()
        };
        // If the conversion fails, which would be a bug, the source is returned: it is an SVG, too.
        self.tree().map_or_else(|_| self.source.clone(), |tree| tree.to_string(&options))
    }

    /// Returns the PNG, with [`PNG_SCALE`] pixels per px.
    pub fn png(&self) -> Result<Vec<u8>, DrawError> {
        let tree = self.tree()?;
        let (width, height) = (self.width * PNG_SCALE, self.height * PNG_SCALE);
        let mut pixels = tiny_skia::Pixmap::new(width, height).ok_or(DrawError::TooLarge { width, height })?;
        let scale = tiny_skia::Transform::from_scale(PNG_SCALE as f32, PNG_SCALE as f32);
        resvg::render(&tree, scale, &mut pixels.as_mut());
        pixels.encode_png().map_err(|e| DrawError::Png(Box::new(e)))
    }

    fn tree(&self) -> Result<usvg::Tree, usvg::Error> {
        usvg::Tree::from_str(&self.source, &OPTIONS)
    }
}

/// Returns the drawn width of a text, px.
pub(super) fn width(text: &str, style: Type) -> f64 {
    let mut canvas = super::canvas::Canvas::new();
    canvas.text(
        [0.0, 50.0],
        text,
        Type { upright: false, halo: false, ..style.anchored(super::canvas::Anchor::Start) },
    );
    let source = canvas.finish(1.0, 1.0);
    let Ok(tree) = usvg::Tree::from_str(&source, &OPTIONS) else { return 0.0 };
    // The first child is the background, the second is the text; it is missing if nothing of the text is visible.
    tree.root().children().get(1).map_or(0.0, |text| f64::from(text.bounding_box().right()))
}

/// Returns the text, cut with an ellipsis if it is wider than `room` px.
pub(super) fn fitted(text: &str, style: Type, room: f64) -> String {
    if width(text, style) <= room {
        return text.to_owned();
    }
    let letters: Vec<char> = text.chars().collect();
    let cut = |n: usize| format!("{}…", letters[..n].iter().collect::<String>().trim_end());
    let (mut fits, mut exceeds) = (0, letters.len());
    while exceeds - fits > 1 {
        let middle = (fits + exceeds) / 2;
        if width(&cut(middle), style) <= room { fits = middle } else { exceeds = middle }
    }
    cut(fits)
}

static OPTIONS: LazyLock<usvg::Options<'static>> = LazyLock::new(|| {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(include_bytes!("../../fonts/Inter-Regular.otf").to_vec());
    fonts.load_font_data(include_bytes!("../../fonts/Inter-SemiBold.otf").to_vec());
    usvg::Options { font_family: "Inter".into(), fontdb: Arc::new(fonts), ..Default::default() }
});
