using System;
using System.Globalization;
using System.Text;

namespace Terraport.Json
{
    /// <summary>
    /// Values as JSON text, as Python writes them: a float has a point or an exponent and the shortest digits that give it
    /// back, an integer neither.
    /// </summary>
    public static class JsonWriter
    {
        /// <summary>Write one value as UTF-8.</summary>
        /// <exception cref="ArgumentException">It holds binary, or a number that is not finite or beyond 64 bits.</exception>
        public static byte[] Write(JsonValue value)
        {
            var into = new StringBuilder();
            Value(value, into);
            return new UTF8Encoding(false, true).GetBytes(into.ToString());
        }

        private static void Value(JsonValue value, StringBuilder into)
        {
            switch (value.Kind)
            {
                case JsonKind.Null:
                    into.Append("null");
                    break;
                case JsonKind.Flag:
                    bool flag;
                    value.TryFlag(out flag);
                    into.Append(flag ? "true" : "false");
                    break;
                case JsonKind.Integer:
                    long integer;
                    value.TryInteger(out integer);
                    into.Append(integer.ToString(CultureInfo.InvariantCulture));
                    break;
                case JsonKind.Float:
                    double number;
                    if (!value.TryNumber(out number)) throw NoForm(value);
                    Float(number, into);
                    break;
                case JsonKind.Text:
                    Text(value.Text, into);
                    break;
                case JsonKind.List:
                    into.Append('[');
                    for (int place = 0; place < value.Count; place++)
                    {
                        if (place > 0) into.Append(',');
                        Value(value[place], into);
                    }
                    into.Append(']');
                    break;
                case JsonKind.Object:
                    Members(value.Members, into);
                    break;
                default:
                    throw NoForm(value);
            }
        }

        private static void Members(JsonObject members, StringBuilder into)
        {
            into.Append('{');
            for (int place = 0; place < members.Count; place++)
            {
                if (place > 0) into.Append(',');
                Text(members.NameAt(place), into);
                into.Append(':');
                Value(members.ValueAt(place), into);
            }
            into.Append('}');
        }

        private static void Text(string text, StringBuilder into)
        {
            into.Append('"');
            foreach (char character in text)
            {
                int known = "\"\\\b\f\n\r\t".IndexOf(character);
                if (known >= 0) into.Append('\\').Append("\"\\bfnrt"[known]);
                else if (character < 0x20) into.Append("\\u").Append(((int)character).ToString("x4", CultureInfo.InvariantCulture));
                else into.Append(character);
            }
            into.Append('"');
        }

        /// <summary>Laid out as Python does: an exponent below 1e-4 and from 1e16.</summary>
        private static void Float(double value, StringBuilder into)
        {
            if (BitConverter.DoubleToInt64Bits(value) < 0) into.Append('-');
            int exponent;
            string digits = ShortestDigits(Math.Abs(value), out exponent);
            if (exponent < -4 || exponent >= 16)
            {
                into.Append(digits[0]);
                if (digits.Length > 1) into.Append('.').Append(digits, 1, digits.Length - 1);
                into.Append(exponent < 0 ? "e-" : "e+");
                into.Append(Math.Abs(exponent).ToString("00", CultureInfo.InvariantCulture));
                return;
            }
            if (exponent < 0)
            {
                into.Append("0.").Append('0', -exponent - 1).Append(digits);
                return;
            }
            int point = exponent + 1;
            into.Append(digits, 0, Math.Min(point, digits.Length)).Append('0', Math.Max(0, point - digits.Length)).Append('.');
            if (digits.Length > point) into.Append(digits, point, digits.Length - point);
            else into.Append('0');
        }

        /// <summary>The fewest digits that give the number back: what "R" promises, and not every platform keeps.</summary>
        private static string ShortestDigits(double size, out int exponent)
        {
            for (int precision = size < 1e-300 ? 0 : 14; ; precision++)
            {
                string text = size.ToString("E" + precision.ToString(CultureInfo.InvariantCulture), CultureInfo.InvariantCulture);
                double back;
                bool isSame = double.TryParse(text, NumberStyles.Float, CultureInfo.InvariantCulture, out back) && back == size;
                if (!isSame && precision < 16) continue;
                int mark = text.IndexOf('E');
                exponent = int.Parse(text.Substring(mark + 1), NumberStyles.AllowLeadingSign, CultureInfo.InvariantCulture);
                string digits = text.Substring(0, mark).Replace(".", "").TrimEnd('0');
                return digits.Length == 0 ? "0" : digits;
            }
        }

        private static ArgumentException NoForm(JsonValue value)
        {
            return new ArgumentException("got " + value.Show() + ", which has no JSON form");
        }
    }
}
