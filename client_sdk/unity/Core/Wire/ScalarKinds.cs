using System;
using System.Globalization;
using System.Text.RegularExpressions;
using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>An integer within bounds.</summary>
    internal sealed class IntegerKind : FieldKind
    {
        private readonly long low;
        private readonly long high;

        internal IntegerKind(long low, long high)
        {
            this.low = low;
            this.high = high;
        }

        internal override object Read(JsonValue raw, object layout)
        {
            long value;
            // A float is never an integer here, also where it is whole: the protocol tells them apart (3.2).
            if (!raw.TryInteger(out value) || value < low || value > high) throw Refuse(raw);
            return value;
        }

        internal override void Check(object value)
        {
            var integer = (long)value;
            if (integer < low || integer > high) throw Refuse(integer.ToString(CultureInfo.InvariantCulture));
        }

        internal override JsonValue Write(object value) { return JsonValue.OfInteger((long)value); }

        internal override string Describe() { return "an integer from " + low + " to " + high; }
    }

    /// <summary>A finite number within bounds, written as a float.</summary>
    internal sealed class NumberKind : FieldKind
    {
        private readonly double low;
        private readonly double high;
        private readonly bool lowExcluded;

        internal NumberKind(double low, double high, bool lowExcluded)
        {
            this.low = low;
            this.high = high;
            this.lowExcluded = lowExcluded;
        }

        internal override object Read(JsonValue raw, object layout)
        {
            double value;
            if (!raw.TryNumber(out value) || !IsWithin(value)) throw Refuse(raw);
            return value;
        }

        internal override void Check(object value)
        {
            if (!IsWithin((double)value)) throw Refuse(JsonValue.OfFloat((double)value));
        }

        internal override JsonValue Write(object value) { return JsonValue.OfFloat((double)value); }

        internal override string Describe()
        {
            return "a number " + (lowExcluded ? "above " : "from ") + JsonValue.OfFloat(low).Show() + " to "
                + JsonValue.OfFloat(high).Show();
        }

        // A NaN fails every comparison.
        private bool IsWithin(double value) { return (lowExcluded ? value > low : value >= low) && value <= high; }
    }

    /// <summary>True or false.</summary>
    internal sealed class FlagKind : FieldKind
    {
        internal override object Read(JsonValue raw, object layout)
        {
            bool value;
            if (!raw.TryFlag(out value)) throw Refuse(raw);
            return value;
        }

        internal override void Check(object value) {}

        internal override JsonValue Write(object value) { return JsonValue.OfFlag((bool)value); }

        internal override string Describe() { return "true or false"; }
    }

    /// <summary>Text; lengths count Unicode code points, and a pattern is met in full.</summary>
    internal sealed class TextKind : FieldKind
    {
        private readonly int minLength;
        private readonly int maxLength;
        // Null where any text will do. Compiled once a field, when the table is made.
        private readonly Regex pattern;

        internal TextKind(int minLength, int maxLength, string pattern)
        {
            this.minLength = minLength;
            this.maxLength = maxLength;
            // \A and \z: $ would let a line end through.
            this.pattern = pattern == null ? null : new Regex("\\A(?:" + pattern + ")\\z", RegexOptions.CultureInvariant);
        }

        internal override object Read(JsonValue raw, object layout)
        {
            string text = raw.Text;
            if (text == null) throw Refuse(raw);
            Check(text);
            return text;
        }

        internal override void Check(object value)
        {
            var text = (string)value;
            int points = 0;
            bool isLone = false;
            for (int index = 0; index < text.Length; index++)
            {
                // A pair of surrogates is one code point, as Python counts.
                points++;
                if (!char.IsSurrogate(text[index])) continue;
                if (index + 1 < text.Length && char.IsSurrogatePair(text[index], text[index + 1]))
                    index++;
                else
                    isLone = true;
            }
            // Length first: a pattern over a hostile text of a megabyte costs time.
            if (points < minLength || points > maxLength) throw Refuse(JsonValue.OfText(text));
            if (isLone) throw new RefusedException("got text with a lone surrogate, expected Unicode text");
            if (pattern != null && !pattern.IsMatch(text)) throw Refuse(JsonValue.OfText(text));
        }

        internal override JsonValue Write(object value) { return JsonValue.OfText((string)value); }

        internal override string Describe()
        {
            string text = "text of " + minLength + " to " + maxLength + " characters";
            return pattern == null ? text : text + " that matches " + pattern;
        }
    }

    /// <summary>One of some words.</summary>
    internal sealed class ChoiceKind : FieldKind
    {
        private readonly string[] options;

        internal ChoiceKind(params string[] options) { this.options = options; }

        internal override object Read(JsonValue raw, object layout)
        {
            string text = raw.Text;
            if (text == null) throw Refuse(raw);
            Check(text);
            return text;
        }

        internal override void Check(object value)
        {
            // A handful of words: a search in order beats a hash.
            if (Array.IndexOf(options, (string)value) < 0) throw Refuse(JsonValue.OfText((string)value));
        }

        internal override JsonValue Write(object value) { return JsonValue.OfText((string)value); }

        internal override string Describe() { return "one of " + string.Join(", ", options); }
    }

    /// <summary>Three numbers of bounded size; not all zero where they are a direction.</summary>
    internal sealed class PositionKind : FieldKind
    {
        private readonly double bound;
        private readonly bool isNonzero;

        internal PositionKind(double bound, bool isNonzero)
        {
            this.bound = bound;
            this.isNonzero = isNonzero;
        }

        internal override object Read(JsonValue raw, object layout)
        {
            if (raw.Kind != JsonKind.List || raw.Count != 3) throw Refuse(raw);
            var position = new Vec3(Side(raw[0]), Side(raw[1]), Side(raw[2]));
            Check(position);
            return position;
        }

        internal override void Check(object value)
        {
            var position = (Vec3)value;
            Check(position.X);
            Check(position.Y);
            Check(position.Z);
            // A direction need not have length 1, but must point somewhere (3.2, rule 4).
            if (isNonzero && position.X == 0 && position.Y == 0 && position.Z == 0)
            {
                throw new RefusedException("got (0, 0, 0), expected a direction");
            }
        }

        internal override JsonValue Write(object value)
        {
            var position = (Vec3)value;
            return JsonValue.OfList(new[] {
                JsonValue.OfFloat(position.X),
                JsonValue.OfFloat(position.Y),
                JsonValue.OfFloat(position.Z),
            });
        }

        internal override string Describe() { return "three finite numbers of size at most " + JsonValue.OfFloat(bound).Show(); }

        private double Side(JsonValue raw)
        {
            double side;
            if (!raw.TryNumber(out side)) throw Refuse(raw);
            return side;
        }

        private void Check(double side)
        {
            // A NaN fails the comparison.
            if (!(Math.Abs(side) <= bound)) throw Refuse(JsonValue.OfFloat(side));
        }
    }
}
