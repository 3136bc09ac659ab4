using System;
using System.Globalization;
using System.Linq;
using System.Text;
using NUnit.Framework;
using Terraport.Json;

namespace Terraport.Tests
{
    /// <summary>The strict JSON reader: what it takes, what it refuses, its bounds.</summary>
    [TestFixture]
    public class JsonReaderTests
    {
        private static JsonValue Read(string text, int maxValues = 1000)
        {
            // In the middle of a larger array, as texts lie in pooled buffers: a reader that passes its end meets a '#'.
            byte[] bytes = Encoding.UTF8.GetBytes("##" + text + "#");
            return JsonReader.Read(new ArraySegment<byte>(bytes, 2, bytes.Length - 3), maxValues);
        }

        /// <summary>What was read, with shortest digits and without blanks.</summary>
        private static string Text(JsonValue value)
        {
            switch (value.Kind)
            {
                case JsonKind.Null: return "null";
                case JsonKind.Text: return "'" + value.Text + "'";
                case JsonKind.List:
                    return "[" + string.Join(",", Enumerable.Range(0, value.Count).Select(index => Text(value[index]))) + "]";
                case JsonKind.Object:
                    return "{"
                        + string.Join(",",
                            Enumerable.Range(0, value.Count)
                                .Select(index => value.Members.NameAt(index) + ":" + Text(value.Members.ValueAt(index))))
                        + "}";
                default: return value.Show();
            }
        }

        [Test]
        public void TextsAreReadWhereverTheyMakeRoomForMore()
        {
            for (int count = 0; count < 600; count++)
            {
                string items = string.Join(",", Enumerable.Repeat("\"x\"", count));
                Assert.AreEqual(count, Read("[" + items + "]").Count);
            }
        }

        [TestCase("{\"a\":[1,-2,3.5,true,false,null,\"x\"],\"b\":{}}", "{a:[1,-2,3.5,true,false,null,'x'],b:{}}")]
        [TestCase("[9223372036854775807,-9223372036854775808,0]", "[9223372036854775807,-9223372036854775808,0]")]
        [TestCase(
            "\"\\\" \\\\ \\b\\f\\n\\r\\t \\u0001 \u00e9\u4e2d\ud83d\ude00 /\"", "'\" \\ \b\f\n\r\t \u0001 \u00e9\u4e2d\ud83d\ude00 /'")]
        [TestCase("\"\\u00e9\\ud83d\\ude00\\/\"", "'\u00e9\ud83d\ude00/'")]
        [TestCase(" [ 1 , 2.50 ,\t-0 , 1E2 ]\r\n", "[1,2.5,0,100]")]
        public void ValuesAreReadAsWhatTheyAre(string text, string shown) { Assert.AreEqual(shown, Text(Read(text))); }

        [TestCase("")]
        [TestCase(" ")]
        [TestCase("nul")]
        [TestCase("[1,]")]
        [TestCase("[1 2]")]
        [TestCase("{\"a\":1,}")]
        [TestCase("{a:1}")]
        [TestCase("{\"a\" 1}")]
        [TestCase("{\"a\":1,\"a\":2}")]
        [TestCase("01")]
        [TestCase("1.")]
        [TestCase(".5")]
        [TestCase("+1")]
        [TestCase("-")]
        [TestCase("1e")]
        [TestCase("NaN")]
        [TestCase("Infinity")]
        [TestCase("\"")]
        [TestCase("\"\n\"")]
        [TestCase("\"\\x\"")]
        [TestCase("\"\\u12g4\"")]
        [TestCase("\"\\u123")]
        [TestCase("[1]]")]
        [TestCase("\ufeff1")]
        public void WhatIsNotExactlyOneValueIsRefused(string text) { Assert.Throws<JsonException>(() => Read(text)); }

        [Test]
        public void BytesThatAreNotUtf8AreRefused()
        {
            foreach (byte[] bytes in new[] {
                         new byte[] { 0x22, 0xff, 0x22 },
                         new byte[] { 0x22, 0xc0, 0x80, 0x22 },
                         new byte[] { 0x22, 0xed, 0xa0, 0x80, 0x22 },
                         new byte[] { 0x22, 0x41, 0xe4, 0xb8, 0x22 },
                     })
            {
                Assert.Throws<JsonException>(() => JsonReader.Read(new ArraySegment<byte>(bytes)));
            }
        }

        [Test]
        public void NestingAndNumberOfValuesAreBounded()
        {
            // The last that is allowed, and the first that is not.
            Assert.AreEqual(1, Read(new string('[', 64) + new string(']', 64)).Count);
            Assert.Throws<JsonException>(() => Read(new string('[', 65) + new string(']', 65)));
            Assert.Throws<JsonException>(() => Read(new string('[', 1000000)));
            Assert.AreEqual(999, Read("[" + string.Join(",", new string[999]).Replace(",", "1,") + "1]").Count);
            Assert.Throws<JsonException>(() => Read("[" + string.Join(",", new string[1000]).Replace(",", "1,") + "1]"));
        }

        [Test]
        public void ManyKeysAreEachThereOnce()
        {
            var text = new StringBuilder("{");
            for (int number = 0; number < 400; number++) text.Append("\"k").Append(number).Append("\":").Append(number).Append(',');
            JsonValue value = Read(text + "\"z\":[]}");
            long last;
            Assert.IsTrue(value["k399"].TryInteger(out last));
            Assert.AreEqual(399, last);
            Assert.IsTrue(value["none"].IsNull);
            // So many keys are sorted to find a repeated one, and not compared pair by pair.
            Assert.Throws<JsonException>(() => Read(text + "\"k17\":[]}"));
        }

        [Test]
        public void NumbersSayWhetherTheyWereIntegers()
        {
            long integer;
            double number;
            Assert.IsTrue(Read("7").TryInteger(out integer));
            Assert.IsFalse(Read("7.0").TryInteger(out integer));
            Assert.IsTrue(Read("7.0").TryNumber(out number));
            Assert.AreEqual(JsonKind.HugeInteger, Read("9223372036854775808").Kind);
            Assert.IsTrue(Read("9223372036854775808").TryNumber(out number));
            Assert.AreEqual(9223372036854775808.0, number);
            Assert.IsFalse(Read("1e999").TryNumber(out number));
            Assert.IsFalse(Read("-1" + new string('0', 400)).TryNumber(out number));
        }

        [Test]
        public void FloatsAreReadToTheLastBit()
        {
            var random = new Random(5);
            var bytes = new byte[8];
            for (int count = 0; count < 5000; count++)
            {
                random.NextBytes(bytes);
                double number = BitConverter.ToDouble(bytes, 0);
                if (double.IsNaN(number) || double.IsInfinity(number)) continue;
                string text = number.ToString("e16", CultureInfo.InvariantCulture);
                double read;
                Assert.IsTrue(Read(text).TryNumber(out read));
                Assert.AreEqual(number, read, text);
            }
        }
    }
}
