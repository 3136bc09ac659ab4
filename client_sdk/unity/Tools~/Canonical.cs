using System;
using System.Collections;
using System.Collections.Generic;
using System.Globalization;
using System.Linq;

namespace Terraport.Tools
{
    /// <summary>Writes values as JSON with sorted keys: equal values have equal texts.</summary>
    internal static class Canonical
    {
        /// <summary>Write dictionaries, lists, strings, numbers, booleans and null; binary in base64.</summary>
        public static string Text(object value)
        {
            if (value == null) return "null";
            if (value is bool) return (bool)value ? "true" : "false";
            if (value is string) return Quoted((string)value);
            if (value is ArraySegment<byte>) return Quoted(Base64((ArraySegment<byte>)value));
            if (value is IDictionary)
            {
                IEnumerable<string> keys = ((IDictionary)value).Keys.Cast<string>().OrderBy(key => key, StringComparer.Ordinal);
                return "{" + string.Join(",", keys.Select(key => Quoted(key) + ":" + Text(((IDictionary)value)[key]))) + "}";
            }
            if (value is IEnumerable) return "[" + string.Join(",", ((IEnumerable)value).Cast<object>().Select(Text)) + "]";
            double number = Convert.ToDouble(value, CultureInfo.InvariantCulture);
            // NaN, a value that is not there, has no number in JSON.
            return double.IsNaN(number) ? "null" : number.ToString("R", CultureInfo.InvariantCulture);
        }

        public static string Base64(ArraySegment<byte> bytes) { return Convert.ToBase64String(bytes.Array, bytes.Offset, bytes.Count); }

        private static string Quoted(string text)
        {
            IEnumerable<string> characters = text.Select(c => c == '"' || c == '\\' ? "\\" + c
                    : c < ' '                                                       ? "\\u" + ((int)c).ToString("x4")
                                                                                    : c.ToString());
            return "\"" + string.Concat(characters) + "\"";
        }
    }
}
