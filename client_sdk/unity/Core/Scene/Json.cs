using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;

namespace Terraport
{
    /// <summary>
    /// A value of a JSON text (RFC 8259). What is absent, or of another type than asked for, is null: so facts that a scene may lack are read
    /// without a check, and those that it must have by Expect.
    /// </summary>
    internal struct Json
    {
        private const int MaxDepth = 64;
        private readonly object value;

        private Json(object value) { this.value = value; }

        /// <summary>Dictionary, List of object, string, double, bool or null.</summary>
        internal object Value => value;

        /// <summary>Read a text that is exactly one value.</summary>
        /// <exception cref="PayloadException">It is not JSON, or nested more than 64 deep.</exception>
        internal static Json Read(ArraySegment<byte> utf8)
        {
            string text;
            try
            {
                text = new UTF8Encoding(false, true).GetString(utf8.Array, utf8.Offset, utf8.Count);
            }
            catch (ArgumentException)
            {
                throw new PayloadException("got a text that is not UTF-8, expected JSON");
            }
            var reader = new Reader(text);
            object read = reader.Value(0);
            reader.ExpectEnd();
            return new Json(read);
        }

        internal bool IsNull => value == null;

        /// <summary>Value of a key of an object.</summary>
        internal Json this[string key]
        {
            get
            {
                object member = null;
                (value as Dictionary<string, object>)?.TryGetValue(key, out member);
                return new Json(member);
            }
        }

        internal string Text => value as string;

        internal double? Number => value is double number ? number : (double?)null;

        internal bool? Flag => value is bool flag ? flag : (bool?)null;

        /// <summary>A whole number that is exact in float64.</summary>
        internal long? Integer => value is double && Math.Floor((double)value) == (double)value && Math.Abs((double)value) < 9e15
            ? (long)(double)value
            : (long?)null;

        /// <summary>Entries of a list; null where it is none.</summary>
        internal IReadOnlyList<Json> List => (value as List<object>)?.ConvertAll(entry => new Json(entry));

        /// <summary>Keys of an object; null where it is none.</summary>
        internal IEnumerable<string> Keys => (value as Dictionary<string, object>)?.Keys;

        /// <summary>A list of three numbers.</summary>
        internal Vec3? Point
        {
            get {
                var list = value as List<object>;
                bool isPoint = list?.Count == 3 && list[0] is double && list[1] is double && list[2] is double;
                return isPoint ? new Vec3((double)list[0], (double)list[1], (double)list[2]) : (Vec3?)null;
            }
        }

        /// <summary>A value that must be there.</summary>
        /// <exception cref="PayloadException">It is not there, or not of its type.</exception>
        internal static T Expect<T>(T? read, string what)
            where T : struct { return read ?? throw new PayloadException("got no " + what + ", expected one"); }

        /// <summary>A value that must be there.</summary>
        /// <exception cref="PayloadException">It is not there, or not of its type.</exception>
        internal static T Expect<T>(T read, string what)
            where T : class { return read ?? throw new PayloadException("got no " + what + ", expected one"); }

        /// <summary>A recursive descent over the text; depth is bounded.</summary>
        private sealed class Reader
        {
            private readonly string text;
            private int at;

            internal Reader(string text) { this.text = text; }

            internal object Value(int depth)
            {
                if (depth > MaxDepth) throw Wrong("values nested more than " + MaxDepth + " deep");
                switch (Next())
                {
                    case '{': return Object(depth);
                    case '[': return List(depth);
                    case '"': return String();
                    case 't': return Word("true", true);
                    case 'f': return Word("false", false);
                    case 'n': return Word("null", null);
                    default: return Number();
                }
            }

            internal void ExpectEnd()
            {
                if (Next() != '\0' || at < text.Length) throw Wrong("something behind the value");
            }

            private Dictionary<string, object> Object(int depth)
            {
                var members = new Dictionary<string, object>();
                at++;
                while (Next() != '}')
                {
                    if (members.Count > 0) Take(',');
                    if (Next() != '"') throw Wrong("no key");
                    string key = String();
                    Next();
                    Take(':');
                    if (members.ContainsKey(key)) throw Wrong("key " + key + " twice");
                    members.Add(key, Value(depth + 1));
                }
                at++;
                return members;
            }

            private List<object> List(int depth)
            {
                var entries = new List<object>();
                at++;
                while (Next() != ']')
                {
                    if (entries.Count > 0) Take(',');
                    entries.Add(Value(depth + 1));
                }
                at++;
                return entries;
            }

            private string String()
            {
                var result = new StringBuilder();
                for (at++; Current() != '"'; at++)
                {
                    if (Current() < ' ') throw Wrong("a control character or the end in a text");
                    result.Append(Current() == '\\' ? Escape() : Current());
                }
                at++;
                return result.ToString();
            }

            private char Escape()
            {
                at++;
                const string letters = "\"\\/bfnrt", meanings = "\"\\/\b\f\n\r\t";
                int letter = letters.IndexOf(Current());
                if (letter >= 0) return meanings[letter];
                string digits = Current() == 'u' && at + 4 < text.Length ? text.Substring(at + 1, 4) : "";
                if (!ushort.TryParse(digits, NumberStyles.AllowHexSpecifier, CultureInfo.InvariantCulture, out ushort code))
                    throw Wrong("an escape");
                at += 4;
                return (char)code;
            }

            private object Word(string word, object meaning)
            {
                if (string.CompareOrdinal(text, at, word, 0, word.Length) != 0) throw Wrong("no value");
                at += word.Length;
                return meaning;
            }

            private object Number()
            {
                int start = at;
                while (at < text.Length && (char.IsDigit(text[at]) || "+-.eE".IndexOf(text[at]) >= 0)) at++;
                string digits = text.Substring(start, at - start);
                // What .NET reads beyond JSON: a sign or a dot at the start, a dot at the end, zeros before a number.
                string whole = digits.TrimStart('-');
                bool isJson = whole.Length > 0 && char.IsDigit(whole[0]) && char.IsDigit(digits[digits.Length - 1])
                    && digits.Length - whole.Length < 2 && !(whole.Length > 1 && whole[0] == '0' && char.IsDigit(whole[1]));
                if (!isJson || !double.TryParse(digits, NumberStyles.Float, CultureInfo.InvariantCulture, out double number))
                    throw Wrong("no value");
                return number;
            }

            private void Take(char expected)
            {
                if (Current() != expected) throw Wrong("no " + expected);
                at++;
            }

            /// <summary>The next character that is not blank; 0 at the end.</summary>
            private char Next()
            {
                while (at < text.Length && " \t\r\n".IndexOf(text[at]) >= 0) at++;
                return Current();
            }

            private char Current() { return at < text.Length ? text[at] : '\0'; }

            private PayloadException Wrong(string got)
            {
                return new PayloadException("got " + got + " at character " + at + ", expected JSON");
            }
        }
    }
}
