using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;

namespace Terraport.Tools
{
    /// <summary>Writes one JSON text, comma by comma.</summary>
    internal sealed class JsonText
    {
        private readonly StringBuilder text = new StringBuilder();
        // Whether a value stands before, at this level: the next one is separated from it.
        private bool needsComma;

        public override string ToString() { return text.ToString(); }

        public JsonText Open(char bracket)
        {
            Separate();
            text.Append(bracket);
            needsComma = false;
            return this;
        }

        public JsonText Close(char bracket)
        {
            text.Append(bracket);
            needsComma = true;
            return this;
        }

        public JsonText Key(string name)
        {
            Separate();
            Quote(name);
            text.Append(':');
            needsComma = false;
            return this;
        }

        public JsonText Null() { return Raw("null"); }

        public JsonText Value(bool value) { return Raw(value ? "true" : "false"); }

        public JsonText Value(long value) { return Raw(value.ToString(CultureInfo.InvariantCulture)); }

        public JsonText Value(double value) { return Raw(value.ToString("R", CultureInfo.InvariantCulture)); }

        public JsonText Value(float value)
        {
            // A float32 has one exact decimal as a double: the reader compares bits.
            return Value((double)value);
        }

        public JsonText Value(string value)
        {
            if (value == null) return Null();
            Separate();
            Quote(value);
            needsComma = true;
            return this;
        }

        public JsonText Values(IEnumerable<uint> values)
        {
            Open('[');
            foreach (uint value in values) Value((long)value);
            return Close(']');
        }

        public JsonText Values(float[] values, int count)
        {
            Open('[');
            for (int at = 0; at < count; at++) Value(values[at]);
            return Close(']');
        }

        private JsonText Raw(string written)
        {
            Separate();
            text.Append(written);
            needsComma = true;
            return this;
        }

        private void Separate()
        {
            if (needsComma) text.Append(',');
        }

        private void Quote(string value)
        {
            text.Append('"');
            foreach (char character in value)
            {
                if (character == '"' || character == '\\')
                    text.Append('\\').Append(character);
                else if (character < 0x20)
                    text.Append("\\u").Append(((int)character).ToString("x4"));
                else
                    text.Append(character);
            }
            text.Append('"');
        }
    }
}
