using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;

namespace Terraport.Json
{
    /// <summary>
    /// A strict reader of one JSON value (RFC 8259) in UTF-8.
    /// </summary>
    /// <remarks>
    /// It refuses what lenient readers hide: repeated keys, a byte order mark, bytes that are not UTF-8, NaN and Infinity,
    /// anything after the value. Nesting is bounded, so no text can exhaust the stack; the number of values is bounded, so
    /// no text takes more memory than a few times its own size.
    /// </remarks>
    public sealed class JsonReader
    {
        /// <summary>Nesting that is read unless another bound is given.</summary>
        public const int DefaultMaxDepth = 64;

        /// <summary>Values of one text that are read unless another bound is given.</summary>
        public const int DefaultMaxValues = 1 << 22;

        // Python's own bound on the digits of an integer: both sides refuse the same messages.
        private const int LongestInteger = 4300;

        private static readonly UTF8Encoding Utf8 = new UTF8Encoding(false, true);

        private readonly byte[] data;
        private readonly int start;
        private readonly int end;
        private readonly int maxDepth;
        private readonly int maxValues;
        private readonly List<JsonValue> values = new List<JsonValue>();
        private readonly List<string> names = new List<string>();
        private StringBuilder builder;
        private int at;
        private int valueCount;

        private JsonReader(ArraySegment<byte> text, int maxDepth, int maxValues)
        {
            data = text.Array;
            start = text.Offset;
            at = start;
            end = start + text.Count;
            this.maxDepth = maxDepth;
            this.maxValues = maxValues;
        }

        /// <summary>Read exactly one value.</summary>
        /// <param name="text">The text as UTF-8.</param>
        /// <param name="maxDepth">Objects and arrays around a value at most.</param>
        /// <param name="maxValues">Values in all at most.</param>
        /// <exception cref="JsonException">It is not exactly one value of JSON, or beyond a bound.</exception>
        public static JsonValue Read(ArraySegment<byte> text, int maxDepth = DefaultMaxDepth, int maxValues = DefaultMaxValues)
        {
            if (text.Array == null) throw new ArgumentNullException("text");
            var reader = new JsonReader(text, maxDepth, maxValues);
            JsonValue value = reader.Value(0);
            reader.SkipBlank();
            int left = reader.end - reader.at;
            if (left > 0) throw reader.Malformed("got " + left + " bytes after the value, expected none");
            return value;
        }

        private JsonValue Value(int depth)
        {
            SkipBlank();
            valueCount++;
            if (valueCount > maxValues) throw Malformed("got more than " + maxValues + " values");
            int first = Peek();
            switch (first)
            {
                case '{': return Object(depth + 1);
                case '[': return List(depth + 1);
                case '"': return JsonValue.OfText(Text());
                case 't': return Word("true", JsonValue.OfFlag(true));
                case 'f': return Word("false", JsonValue.OfFlag(false));
                case 'n': return Word("null", default(JsonValue));
            }
            if (first == '-' || IsDigit(first)) return Number();
            throw Unexpected("a value");
        }

        private JsonValue Word(string word, JsonValue value)
        {
            for (int place = 0; place < word.Length; place++)
            {
                if (at + place >= end || data[at + place] != word[place]) throw Unexpected("a value");
            }
            at += word.Length;
            return value;
        }

        private JsonValue Number()
        {
            int first = at;
            bool negative = Peek() == '-';
            if (negative) at++;
            int digits = at;
            if (!IsDigit(Peek())) throw Unexpected("a digit");
            if (Peek() == '0') at++;
            else SkipDigits();
            int whole = at;
            bool isFloat = false;
            if (Peek() == '.' && IsDigit(PeekAt(at + 1)))
            {
                isFloat = true;
                at++;
                SkipDigits();
            }
            if (Peek() == 'e' || Peek() == 'E')
            {
                int tail = at + 1;
                if (PeekAt(tail) == '+' || PeekAt(tail) == '-') tail++;
                if (IsDigit(PeekAt(tail)))
                {
                    isFloat = true;
                    at = tail;
                    SkipDigits();
                }
            }
            if (isFloat) return JsonValue.OfFloat(Double(first));
            if (whole - first > LongestInteger) throw Malformed("got an integer of " + (whole - digits) + " digits, which is too long");
            if (whole - digits > 18) return LongInteger(first);
            long size = 0;
            for (int place = digits; place < whole; place++) size = 10 * size + (data[place] - '0');
            return JsonValue.OfInteger(negative ? -size : size);
        }

        private JsonValue LongInteger(int first)
        {
            long integer;
            string text = Encoding.ASCII.GetString(data, first, at - first);
            if (long.TryParse(text, NumberStyles.AllowLeadingSign, CultureInfo.InvariantCulture, out integer))
            {
                return JsonValue.OfInteger(integer);
            }
            return JsonValue.OfHugeInteger(Double(first));
        }

        private double Double(int first)
        {
            // The sign apart: some platforms lose that of a zero.
            bool negative = data[first] == '-';
            if (negative) first++;
            double size;
            string text = Encoding.ASCII.GetString(data, first, at - first);
            // The grammar was right: some platforms refuse what is beyond a double instead of giving infinity.
            if (!double.TryParse(text, NumberStyles.Float, CultureInfo.InvariantCulture, out size)) size = double.PositiveInfinity;
            return negative ? -size : size;
        }

        private JsonValue List(int depth)
        {
            Enter(depth);
            int mark = values.Count;
            if (!Next(']'))
            {
                for (;;)
                {
                    values.Add(Value(depth));
                    if (Next(']')) break;
                    if (!Next(',')) throw Unexpected("a comma or ]");
                }
            }
            return JsonValue.OfList(Taken(values, mark));
        }

        private JsonValue Object(int depth)
        {
            Enter(depth);
            int mark = values.Count;
            int nameMark = names.Count;
            if (!Next('}'))
            {
                for (;;)
                {
                    SkipBlank();
                    if (Peek() != '"') throw Unexpected("a key in quotes");
                    string name = Text();
                    names.Add(name);
                    if (!Next(':')) throw Unexpected("a colon");
                    values.Add(Value(depth));
                    if (Next('}')) break;
                    if (!Next(',')) throw Unexpected("a comma or }");
                }
            }
            string repeated = JsonObject.FirstRepeated(names, nameMark);
            if (repeated != null)
            {
                throw Malformed("got key " + JsonValue.ShowText(repeated) + " twice, expected each key once");
            }
            return JsonValue.OfObject(new JsonObject(Taken(names, nameMark), Taken(values, mark)));
        }

        private static T[] Taken<T>(List<T> stack, int mark)
        {
            var taken = new T[stack.Count - mark];
            stack.CopyTo(mark, taken, 0, taken.Length);
            stack.RemoveRange(mark, taken.Length);
            return taken;
        }

        private void Enter(int depth)
        {
            if (depth > maxDepth) throw Malformed("got nesting beyond " + maxDepth + " levels");
            at++;
        }

        private string Text()
        {
            at++;
            int run = SkipRun();
            if (Peek() == '"')
            {
                string plain = Decoded(run);
                at++;
                return plain;
            }
            if (builder == null) builder = new StringBuilder();
            builder.Length = 0;
            for (;;)
            {
                builder.Append(Decoded(run));
                if (Peek() == '"') break;
                if (Peek() != '\\') throw Unexpected("the end of a text");
                builder.Append(Escape());
                run = SkipRun();
            }
            at++;
            return builder.ToString();
        }

        /// <summary>Step to the next quote, backslash or control character; returns where the run began.</summary>
        private int SkipRun()
        {
            int run = at;
            while (at < end && data[at] >= 0x20 && data[at] != '"' && data[at] != '\\') at++;
            return run;
        }

        private string Decoded(int run)
        {
            try
            {
                return Utf8.GetString(data, run, at - run);
            }
            catch (ArgumentException)
            {
                throw new JsonException("got text that is not UTF-8", run - start);
            }
        }

        private char Escape()
        {
            int letter = PeekAt(at + 1);
            int known = "\"\\/bfnrtu".IndexOf((char)Math.Max(letter, 0));
            if (letter < 0 || known < 0) throw Unexpected("an escape of JSON");
            at += 2;
            if (letter != 'u') return "\"\\/\b\f\n\r\t"[known];
            int code = 0;
            for (int digit = 0; digit < 4; digit++)
            {
                int size = HexDigit(Peek());
                if (size < 0) throw Unexpected("four hexadecimal digits");
                code = 16 * code + size;
                at++;
            }
            return (char)code;
        }

        private static int HexDigit(int character)
        {
            if (IsDigit(character)) return character - '0';
            int lower = character | 0x20;
            return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
        }

        /// <summary>Step over a character if it is the next one that is no blank.</summary>
        private bool Next(char character)
        {
            SkipBlank();
            if (Peek() != character) return false;
            at++;
            return true;
        }

        private void SkipBlank()
        {
            while (at < end && (data[at] == ' ' || data[at] == '\t' || data[at] == '\n' || data[at] == '\r')) at++;
        }

        private void SkipDigits()
        {
            while (at < end && IsDigit(data[at])) at++;
        }

        private int Peek()
        {
            return PeekAt(at);
        }

        private int PeekAt(int place)
        {
            return place < end ? data[place] : -1;
        }

        private static bool IsDigit(int character)
        {
            return character >= '0' && character <= '9';
        }

        private JsonException Unexpected(string expected)
        {
            int next = Peek();
            string got = next < 0 ? "the end" : next >= 0x20 && next < 0x7f ? "\"" + (char)next + "\"" : "byte " + next;
            return Malformed("got " + got + ", expected " + expected);
        }

        private JsonException Malformed(string text)
        {
            return new JsonException(text, at - start);
        }
    }
}
