using System;
using System.Collections.Generic;
using System.Globalization;

namespace Terraport.Tools
{
    /// <summary>One step of a visit, such as <c>land:0,1,0,60</c>.</summary>
    internal sealed class LandStep
    {
        private LandStep(string text)
        {
            Text = text;
            int colon = text.IndexOf(':');
            Kind = colon < 0 ? text : text.Substring(0, colon);
            Argument = colon < 0 ? "" : text.Substring(colon + 1);
            var numbers = new List<double>();
            foreach (string field in Argument.Split(','))
            {
                double number;
                // The token of reconnect is no number, and is taken as text.
                if (!double.TryParse(field, NumberStyles.Float, CultureInfo.InvariantCulture, out number)) break;
                numbers.Add(number);
            }
            Numbers = numbers.ToArray();
        }

        /// <summary>As it was written.</summary>
        public string Text { get; private set; }

        /// <summary>land, start, wait, aim, pick, stand, pause, reconnect, join, people, gather, follow, barrier, leave.</summary>
        public string Kind { get; private set; }

        /// <summary>What stands behind the colon.</summary>
        public string Argument { get; private set; }

        public double[] Numbers { get; private set; }

        /// <summary>Whether it waits for a landing.</summary>
        public bool IsLanding => Kind == "land" || Kind == "start" || Kind == "wait";

        /// <summary>Whether it waits for an answer of the group's.</summary>
        public bool IsOfGroup => Kind == "join" || Kind == "gather";

        /// <summary>Read a step; null where there is no such one.</summary>
        public static LandStep Parse(string text)
        {
            var step = new LandStep(text);
            int minNumbers;
            switch (step.Kind)
            {
                case "land":
                case "start":
                case "gather":
                case "aim": minNumbers = 4; break;
                case "pick":
                case "stand": minNumbers = 3; break;
                case "follow":
                case "people":
                case "barrier":
                case "pause": minNumbers = 1; break;
                case "join":
                case "leave":
                case "wait":
                case "reconnect": minNumbers = 0; break;
                default: return null;
            }
            return step.Numbers.Length < minNumbers ? null : step;
        }

        /// <summary>Three of the numbers, from one on.</summary>
        public Vec3 Position(int at) { return new Vec3(Numbers[at], Numbers[at + 1], Numbers[at + 2]); }
    }
}
