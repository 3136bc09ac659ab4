using System;
using System.Collections.Generic;
using System.Linq;

namespace Terraport.Wire
{
    /// <summary>Fields of a message or of a part of one, checked as they are read. Unknown fields are skipped.</summary>
    internal struct Fields
    {
        internal const long MaxU32 = uint.MaxValue, MaxInteger = (1L << 53) - 1;
        private const double MaxCoordinateM = 1e7;

        private readonly Dictionary<string, object> values;
        private readonly string owner;

        internal Fields(Dictionary<string, object> values, string owner)
        {
            this.values = values;
            this.owner = owner;
        }

        /// <summary>Whether a field is there; nil is as if it were not.</summary>
        internal bool Has(string key) { return values.TryGetValue(key, out object value) && value != null; }

        internal string Text(string key, int longest, int shortest = 0)
        {
            string text = values.TryGetValue(key, out object value) ? value as string : null;
            // Counted in code points, as the specification does.
            int length = text == null ? -1 : text.Length - text.Count(char.IsLowSurrogate);
            return length >= shortest && length <= longest ? text
                                                           : throw Wrong(key, "text of " + shortest + " to " + longest + " characters");
        }

        internal string OptionalText(string key, int longest, int shortest = 0) { return Has(key) ? Text(key, longest, shortest) : null; }

        internal string Choice(string key, params string[] choices)
        {
            string text = values.TryGetValue(key, out object value) ? value as string : null;
            return choices.Contains(text) ? text : throw Wrong(key, "one of " + string.Join(", ", choices));
        }

        internal string OptionalChoice(string key, params string[] choices) { return Has(key) ? Choice(key, choices) : null; }

        internal bool Flag(string key)
        {
            return values.TryGetValue(key, out object value) && value is bool ? (bool)value : throw Wrong(key, "true or false");
        }

        internal long Integer(string key, long least, long most)
        {
            long number = values.TryGetValue(key, out object value) && value is long ? (long)value : long.MinValue;
            return number >= least && number <= most ? number : throw Wrong(key, "an integer of " + least + " to " + most);
        }

        internal uint Unsigned(string key, uint least = 0) { return (uint)Integer(key, least, MaxU32); }

        internal long? OptionalInteger(string key, long least, long most) { return Has(key) ? Integer(key, least, most) : (long?)null; }

        internal uint? OptionalUnsigned(string key) { return Has(key) ? Unsigned(key) : (uint?)null; }

        internal double Number(string key, double least, double most, bool isLeastExcluded = false)
        {
            double number = NumberOf(values.TryGetValue(key, out object value) ? value : null);
            bool isWithin = isLeastExcluded ? number > least : number >= least;
            return isWithin && number <= most ? number : throw Wrong(key, "a number of " + least + " to " + most);
        }

        internal double? OptionalNumber(string key, double least, double most, bool isLeastExcluded = false)
        {
            return Has(key) ? Number(key, least, most, isLeastExcluded) : (double?)null;
        }

        internal Vec3 Point(string key, double most = MaxCoordinateM)
        {
            object[] list = values.TryGetValue(key, out object value) ? value as object[] : null;
            double[] numbers = list == null ? new double[0] : list.Select(NumberOf).ToArray();
            // False for NaN as well.
            bool isPoint = numbers.Length == 3 && numbers.All(number => Math.Abs(number) <= most);
            return isPoint ? new Vec3(numbers[0], numbers[1], numbers[2]) : throw Wrong(key, "three numbers of at most " + most);
        }

        internal Vec3? OptionalPoint(string key) { return Has(key) ? Point(key) : (Vec3?)null; }

        internal ArraySegment<byte> Binary(string key, int rowBytes, int mostRows)
        {
            ArraySegment<byte> bytes = default;
            bool isBinary = values.TryGetValue(key, out object value) && value is ArraySegment<byte>;
            if (isBinary) bytes = (ArraySegment<byte>)value;
            bool isTable = isBinary && bytes.Count % rowBytes == 0 && bytes.Count / rowBytes <= mostRows;
            return isTable ? bytes : throw Wrong(key, "binary of at most " + mostRows + " rows of " + rowBytes + " bytes");
        }

        internal Fields Part(string key)
        {
            var part = values.TryGetValue(key, out object value) ? value as Dictionary<string, object> : null;
            return new Fields(part ?? throw Wrong(key, "a map"), owner + "." + key);
        }

        internal Fields[] Parts(string key, int most)
        {
            object[] list = values.TryGetValue(key, out object value) ? value as object[] : null;
            if (list == null || list.Length > most) throw Wrong(key, "a list of at most " + most + " maps");
            string name = owner + "." + key;
            WireException wrong = Wrong(key, "a list of maps");
            return list.Select(item => new Fields(item as Dictionary<string, object> ?? throw wrong, name)).ToArray();
        }

        /// <summary>Return a map of names to finite numbers, at most so many.</summary>
        internal Dictionary<string, double> Numbers(string key, int most)
        {
            Fields part = Part(key);
            if (part.values.Count > most) throw Wrong(key, "at most " + most + " numbers");
            return part.values.Keys.ToDictionary(name => name, name => part.Number(name, -double.MaxValue, double.MaxValue));
        }

        private static double NumberOf(object value) { return value is double ? (double)value : value is long ? (long)value : double.NaN; }

        private WireException Wrong(string key, string expected)
        {
            values.TryGetValue(key, out object value);
            string text = value is string                               ? "\"" + value + "\""
                : value is Array || value is Dictionary<string, object> ? "a container"
                                                                        : "" + value;
            string got = value == null ? "nothing" : text.Length > 80 ? text.Substring(0, 80) : text;
            return new WireException(owner + "." + key + ": got " + got + ", expected " + expected);
        }
    }
}
