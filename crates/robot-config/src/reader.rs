//! A TOML file read key by key: every problem is noted with its line, none ends the reading.

mod diagnostics;
mod lists;
mod section;
mod values;

pub(crate) use diagnostics::Diagnostics;
pub(crate) use problem::Allowed;
pub(crate) use section::Section;

use toml::de::DeValue;

/// A value and where it stands.
pub(crate) struct At<T> {
    pub(crate) value: T,
    pub(crate) place: usize,
}

/// A value as the file has it, with what a list or a table has in it.
fn whole(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Array(items) => {
            let items: Vec<String> = items.iter().map(|item| whole(item.get_ref())).collect();
            format!("[{}]", items.join(", "))
        }
        DeValue::Table(table) => {
            let pair = |(key, value): (&toml::Spanned<_>, &toml::Spanned<DeValue<'_>>)| {
                let key: &std::borrow::Cow<'_, str> = key.get_ref();
                format!("{key} = {}", whole(value.get_ref()))
            };
            let pairs: Vec<String> = table.iter().map(pair).collect();
            format!("{{ {} }}", pairs.join(", "))
        }
        one => show(one),
    }
}

/// A value as the file has it, for messages.
fn show(value: &DeValue<'_>) -> String {
    match value {
        DeValue::Float(text) => match text.as_str().trim_start_matches(['+', '-']) {
            "nan" => "NaN".to_owned(),
            _ => text.as_str().to_owned(),
        },
        DeValue::Integer(text) => text.as_str().to_owned(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::String(text) => format!("{text:?}"),
        DeValue::Datetime(date) => date.to_string(),
        DeValue::Array(_) => "a list".to_owned(),
        DeValue::Table(_) => "a table".to_owned(),
    }
}
