using System;
using Terraport.Json;

namespace Terraport
{
    /// <summary>Values out of a scene's JSON files, each checked for what it is before it is used.</summary>
    internal static class SceneJson
    {
        internal static JsonValue ExpectObject(JsonValue value, string label)
        {
            return value.Kind == JsonKind.Object ? value : throw Wrong(value, label, "an object");
        }

        internal static JsonValue ExpectList(JsonValue value, string label)
        {
            return value.Kind == JsonKind.List ? value : throw Wrong(value, label, "a list");
        }

        internal static string ExpectText(JsonValue value, string label)
        {
            return string.IsNullOrEmpty(value.Text) ? throw Wrong(value, label, "text") : value.Text;
        }

        /// <summary>A text of exactly <paramref name="length"/> lower-case hexadecimal digits.</summary>
        internal static string ExpectDigits(JsonValue value, string label, int length)
        {
            string text = value.Text;
            // Lower case alone, as writers must: two spellings of one version would be two versions to a cache.
            bool isValid = text != null && text.Length == length;
            for (int at = 0; isValid && at < length; at++)
            {
                isValid = (text[at] >= '0' && text[at] <= '9') || (text[at] >= 'a' && text[at] <= 'f');
            }
            return isValid ? text : throw Wrong(value, label, length + " hexadecimal digits");
        }

        internal static double ExpectNumber(JsonValue value, string label)
        {
            double number;
            return value.TryNumber(out number) ? number : throw Wrong(value, label, "a finite number");
        }

        internal static long ExpectWhole(JsonValue value, string label, long min, long max)
        {
            long number;
            bool isValid = value.TryInteger(out number) && number >= min && number <= max;
            return isValid ? number : throw Wrong(value, label, "a whole number from " + min + " to " + max);
        }

        internal static bool ExpectFlag(JsonValue value, string label)
        {
            bool flag;
            return value.TryFlag(out flag) ? flag : throw Wrong(value, label, "true or false");
        }

        internal static Vec3 ExpectTriple(JsonValue value, string label)
        {
            if (ExpectList(value, label).Count != 3)
            {
                throw Wrong(value, label, "three numbers");
            }
            return new Vec3(ExpectNumber(value[0], label), ExpectNumber(value[1], label), ExpectNumber(value[2], label));
        }

        /// <summary>A finite number, or null for anything else: what is informative must not be in the way.</summary>
        internal static double? NumberOrNull(JsonValue value)
        {
            double number;
            return value.TryNumber(out number) ? number : (double?)null;
        }

        /// <summary>Three finite numbers, or null for anything else.</summary>
        internal static Vec3? TripleOrNull(JsonValue value)
        {
            // For facts that are only shown: what is odd is left out, not refused.
            if (value.Kind != JsonKind.List || value.Count != 3)
            {
                return null;
            }
            double? x = NumberOrNull(value[0]);
            double? y = NumberOrNull(value[1]);
            double? z = NumberOrNull(value[2]);
            return x == null || y == null || z == null ? (Vec3?)null : new Vec3(x.Value, y.Value, z.Value);
        }

        internal static PayloadException Wrong(JsonValue value, string label, string expected)
        {
            return new PayloadException(label + " is " + value.Show() + ", expected " + expected);
        }
    }
}
