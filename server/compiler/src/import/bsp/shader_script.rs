//! Shader scripts: the image of a shader, when no image has its name.

use std::collections::HashMap;

/// The most shaders.
const SHADERS_MAX: usize = 1 << 17;

/// Images by shader, all in lower case.
#[derive(Debug, Default)]
pub(super) struct Scripts {
    images: HashMap<String, String>,
}

/// A shader that is being read.
#[derive(Default)]
struct Shader {
    name: String,
    stage: Option<String>,
    editor: Option<String>,
}

impl Scripts {
    /// Reads the shaders of one script. The first of a name counts.
    pub(super) fn read(&mut self, text: &str) {
        let mut depth = 0usize;
        let mut shader = Shader::default();
        for line in text.lines() {
            let line = line.split("//").next().unwrap_or_default();
            let spaced = line.replace('{', " { ").replace('}', " } ");
            let mut words = spaced.split_ascii_whitespace().peekable();
            while let Some(word) = words.next() {
                match word {
                    "{" => depth += 1,
                    "}" => {
                        depth = depth.saturating_sub(1);
                        if depth == 0 {
                            self.keep(std::mem::take(&mut shader));
                        }
                    }
                    name if depth == 0 => shader.name = name.to_ascii_lowercase(),
                    key => {
                        let before_brace = |w: &&str| !matches!(*w, "{" | "}");
                        let values: Vec<&str> =
                            std::iter::from_fn(|| words.next_if(before_brace)).collect();
                        shader.line(depth, key, &values);
                    }
                }
            }
        }
    }

    /// The image of a shader.
    pub(super) fn image(&self, shader: &str) -> Option<&str> {
        self.images.get(shader).map(String::as_str)
    }

    fn keep(&mut self, shader: Shader) {
        if let Some(image) = shader.stage.or(shader.editor)
            && self.images.len() < SHADERS_MAX
        {
            self.images.entry(shader.name).or_insert(image);
        }
    }
}

impl Shader {
    fn line(&mut self, depth: usize, key: &str, values: &[&str]) {
        let key = key.to_ascii_lowercase();
        let image = match key.as_str() {
            "qer_editorimage" | "map" | "clampmap" => values.first(),
            // The frequency comes before the frames.
            "animmap" => values.get(1),
            _ => None,
        };
        let Some(image) = image.filter(|image| !image.starts_with(['$', '*'])) else { return };
        let known = if depth == 1 { &mut self.editor } else { &mut self.stage };
        known.get_or_insert_with(|| image.to_ascii_lowercase());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_real_stage_counts_then_the_editors_image() {
        let mut scripts = Scripts::default();
        scripts.read(
            "textures/a/lamp\n{\n qer_editorimage textures/a/lamp_ed.tga // odd\n {\n map $lightmap\n }\n\
             {\n MAP textures/a/Lamp_blend.tga\n blendFunc add\n }\n}\n\
             textures/a/fan { { animmap 8 textures/a/fan1.tga textures/a/fan2.tga } }\n\
             textures/a/plain {\n qer_editorimage textures/a/plain.tga\n surfaceparm nomarks\n}\n\
             textures/a/none { surfaceparm nodraw }",
        );
        assert_eq!(scripts.image("textures/a/lamp"), Some("textures/a/lamp_blend.tga"));
        assert_eq!(scripts.image("textures/a/fan"), Some("textures/a/fan1.tga"));
        assert_eq!(scripts.image("textures/a/plain"), Some("textures/a/plain.tga"));
        assert_eq!(scripts.image("textures/a/none"), None);
    }
}
