//! Names and lines: text that came from a peer and is fit to be shown.

use std::fmt;

use serde::{Deserialize, Serialize};

/// No name has more characters.
pub const NAME_CHARS_MAX: usize = 32;
/// No line has more characters.
pub const LINE_CHARS_MAX: usize = 256;

/// Why a text is not fit to be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TextError {
    /// Nothing, or only spaces.
    #[error("empty")]
    Empty,
    /// Too many characters.
    #[error("longer than {0} characters")]
    TooLong(usize),
    /// A control or an invisible formatting character.
    #[error("with characters that cannot be shown")]
    Unprintable,
}

/// How somebody is called: 1 to 32 characters, none of them a control character, no space at
/// either end.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Name(String);

/// What somebody says: 1 to 256 characters, none of them a control character, no space at either
/// end.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ChatLine(String);

impl Name {
    /// Trims the text and takes it if it is fit.
    pub fn new(text: &str) -> Result<Self, TextError> {
        fit(text, NAME_CHARS_MAX).map(Self)
    }

    /// As much of a text as fits, without what cannot be shown; for words of our own.
    pub fn clipped(text: &str) -> Self {
        Self(clip(text, NAME_CHARS_MAX))
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl ChatLine {
    /// Trims the text and takes it if it is fit.
    pub fn new(text: &str) -> Result<Self, TextError> {
        fit(text, LINE_CHARS_MAX).map(Self)
    }

    /// As much of a text as fits, without what cannot be shown; for words of our own.
    pub fn clipped(text: &str) -> Self {
        Self(clip(text, LINE_CHARS_MAX))
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for Name {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        Self::new(&text)
    }
}

impl TryFrom<String> for ChatLine {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        Self::new(&text)
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

impl From<ChatLine> for String {
    fn from(line: ChatLine) -> Self {
        line.0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Display for ChatLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

fn fit(text: &str, chars_max: usize) -> Result<String, TextError> {
    let text = text.trim();
    if text.is_empty() {
        return Err(TextError::Empty);
    }
    if text.chars().count() > chars_max {
        return Err(TextError::TooLong(chars_max));
    }
    if !text.chars().all(is_shown) {
        return Err(TextError::Unprintable);
    }
    Ok(text.to_owned())
}

/// A dash when nothing can be shown.
fn clip(text: &str, chars_max: usize) -> String {
    let shown: String = text.trim().chars().filter(|&c| is_shown(c)).take(chars_max).collect();
    fit(&shown, chars_max).unwrap_or_else(|_| "-".to_owned())
}

/// Not a control character, nor one of the marks that reorder, hide or break the text around them.
fn is_shown(c: char) -> bool {
    !c.is_control()
        && !matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}'
            | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_trimmed_and_checked() {
        let long = "x".repeat(NAME_CHARS_MAX + 1);
        for (text, expected) in [
            ("Ada", Ok("Ada")),
            ("  Ada Lovelace ", Ok("Ada Lovelace")),
            ("Ζωή 🦉", Ok("Ζωή 🦉")),
            ("", Err(TextError::Empty)),
            (" \t ", Err(TextError::Empty)),
            ("a\nb", Err(TextError::Unprintable)),
            ("a\u{1b}[31mb", Err(TextError::Unprintable)),
            ("a\u{202e}b", Err(TextError::Unprintable)),
            (&long, Err(TextError::TooLong(NAME_CHARS_MAX))),
        ] {
            assert_eq!(Name::new(text).as_ref().map(Name::as_str), expected.as_ref().map(|t| *t));
        }
        assert_eq!(Name::new(&long[1..]).unwrap().as_str().len(), NAME_CHARS_MAX);
    }

    #[test]
    fn our_own_words_are_cut_to_fit() {
        assert_eq!(ChatLine::clipped("full\n").as_str(), "full");
        assert_eq!(ChatLine::clipped("\n").as_str(), "-");
        assert_eq!(Name::clipped(" a\u{7}b ").as_str(), "ab");
        assert_eq!(ChatLine::clipped(&"é".repeat(999)).as_str().chars().count(), LINE_CHARS_MAX);
    }
}
