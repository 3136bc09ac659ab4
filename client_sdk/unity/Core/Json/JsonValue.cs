using System;

namespace Terraport.Json
{
    /// <summary>
    /// One value as received, before anybody has asked what it should be. Integers and floats are told apart, since the
    /// wire protocol does. The default value is null.
    /// </summary>
    public readonly struct JsonValue
    {
        // What the kind says: string, JsonValue[], JsonObject, or the array that binary lies in.
        private readonly object reference;
        // Flag, integer, the bits of a double, or of binary: offset (upper 32) and length (lower 32).
        private readonly long bits;
        private readonly JsonKind kind;

        private JsonValue(JsonKind kind, long bits, object reference)
        {
            this.kind = kind;
            this.bits = bits;
            this.reference = reference;
        }

        /// <summary>What the value is, which decides what can be read of it.</summary>
        public JsonKind Kind => kind;

        /// <summary>Whether it is null, or stands for a member that is absent.</summary>
        public bool IsNull => kind == JsonKind.Null;

        /// <summary>The text; null where it is none.</summary>
        public string Text => kind == JsonKind.Text ? (string)reference : null;

        /// <summary>The members; null where it is no object.</summary>
        public JsonObject Members => kind == JsonKind.Object ? (JsonObject)reference : null;

        /// <summary>Number of items of a list, of members of an object, of bytes of binary; else 0.</summary>
        public int Count
        {
            get {
                switch (kind)
                {
                    case JsonKind.List: return ((JsonValue[])reference).Length;
                    case JsonKind.Object: return ((JsonObject)reference).Count;
                    case JsonKind.Binary: return (int)(bits & 0xffffffffL);
                    default: return 0;
                }
            }
        }

        /// <summary>The bytes of binary, a view of what was read; empty where it is none.</summary>
        public ArraySegment<byte> Bytes
        {
            get {
                if (kind != JsonKind.Binary) return default(ArraySegment<byte>);
                return new ArraySegment<byte>((byte[])reference, (int)(bits >> 32), (int)(bits & 0xffffffffL));
            }
        }

        /// <summary>An item of a list.</summary>
        /// <exception cref="InvalidOperationException">It is no list.</exception>
        /// <exception cref="IndexOutOfRangeException">There is no such item.</exception>
        public JsonValue this[int index]
        {
            get
            {
                if (kind != JsonKind.List) throw new InvalidOperationException("got " + Show() + ", expected a list");
                return ((JsonValue[])reference)[index];
            }
        }

        /// <summary>A member of an object; null where there is none of that name, or where it is no object.</summary>
        public JsonValue this[string name]
        {
            get
            {
                JsonValue value = default(JsonValue);
                // Absent, null and "no object" read alike: callers ask for what they need, and name what is missing.
                if (kind == JsonKind.Object) ((JsonObject)reference).TryGet(name, out value);
                return value;
            }
        }

        /// <summary>Read true or false; false where it is neither.</summary>
        public bool TryFlag(out bool flag)
        {
            flag = kind == JsonKind.Flag && bits != 0;
            return kind == JsonKind.Flag;
        }

        /// <summary>Read an integer that fits into 64 bits; false where it is another value, floats included.</summary>
        public bool TryInteger(out long integer)
        {
            integer = kind == JsonKind.Integer ? bits : 0;
            return kind == JsonKind.Integer;
        }

        /// <summary>Read any number as a double; false where it is no number, or not finite as a double.</summary>
        public bool TryNumber(out double number)
        {
            switch (kind)
            {
                case JsonKind.Integer: number = bits; return true;
                case JsonKind.Float:
                case JsonKind.HugeInteger:
                    number = BitConverter.Int64BitsToDouble(bits);
                    // JSON has neither, but msgpack does.
                    return !double.IsNaN(number) && !double.IsInfinity(number);
                default: number = 0; return false;
            }
        }

        /// <summary>Say what it is in an error text, with at most a few dozen characters of it.</summary>
        public string Show()
        {
            switch (kind)
            {
                case JsonKind.Flag: return bits != 0 ? "true" : "false";
                case JsonKind.Integer: return bits.ToString(System.Globalization.CultureInfo.InvariantCulture);
                case JsonKind.HugeInteger: return "an integer beyond 64 bits";
                case JsonKind.Float:
                    return BitConverter.Int64BitsToDouble(bits).ToString("R", System.Globalization.CultureInfo.InvariantCulture);
                case JsonKind.Text: return ShowText((string)reference);
                case JsonKind.List: return "a list of " + Count;
                case JsonKind.Object: return "a map of " + Count;
                case JsonKind.Binary: return Count + " bytes of binary";
                default: return "nothing";
            }
        }

        /// <summary>True or false as a value.</summary>
        public static JsonValue OfFlag(bool flag) { return new JsonValue(JsonKind.Flag, flag ? 1 : 0, null); }

        /// <summary>An integer as a value.</summary>
        public static JsonValue OfInteger(long integer) { return new JsonValue(JsonKind.Integer, integer, null); }

        /// <summary>An integer beyond 64 bits, as the double nearest to it.</summary>
        public static JsonValue OfHugeInteger(double nearest)
        {
            return new JsonValue(JsonKind.HugeInteger, BitConverter.DoubleToInt64Bits(nearest), null);
        }

        /// <summary>A float as a value, whole or not.</summary>
        public static JsonValue OfFloat(double number)
        {
            return new JsonValue(JsonKind.Float, BitConverter.DoubleToInt64Bits(number), null);
        }

        /// <summary>Text as a value; null gives null.</summary>
        public static JsonValue OfText(string text) { return text == null ? default(JsonValue) : new JsonValue(JsonKind.Text, 0, text); }

        /// <summary>Items as a value; the array is kept, not copied.</summary>
        public static JsonValue OfList(JsonValue[] items) { return new JsonValue(JsonKind.List, 0, items); }

        /// <summary>Members as a value.</summary>
        public static JsonValue OfObject(JsonObject members) { return new JsonValue(JsonKind.Object, 0, members); }

        /// <summary>Bytes as a value; they are kept, not copied.</summary>
        public static JsonValue OfBinary(ArraySegment<byte> bytes)
        {
            return new JsonValue(JsonKind.Binary, ((long)bytes.Offset << 32) | (uint)bytes.Count, bytes.Array);
        }

        internal static string ShowText(string text)
        {
            return text.Length > 48 ? "\"" + text.Substring(0, 48) + "\"... (" + text.Length + " long)" : "\"" + text + "\"";
        }
    }
}
